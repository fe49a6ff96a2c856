"""SciPy's explicit integrators RK45 and DOP853 on their natural steps. h is only the output grid, which dense output fills.

They are used as they are, with a compiled right-hand side. Nearly all of the 5 to 150 µs of a step is interpretation:
`rk45_fixed` and `dop853` show what the formulas cost without it. J3, whose derivative vanishes, is conserved.

The local error is kept below atol + rtol |y_i|, as a root mean square over the components. SciPy counts the right-hand sides;
the number of rejected steps follows from the number of stages.

Sources: Dormand & Prince, J. Comput. Appl. Math. 6 (1980) 19; Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations
I (1993), II.5; Virtanen et al., Nature Methods 17 (2020) 261.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import scipy.integrate

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Problem, Run, dense
from lagrange_bench.integrators.methods.dop853 import check_tolerances
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.system import System


@cache
def right_hand_side(system: System) -> Callable[..., Any]:
    """(c, t, y) → y' of any system; c : the time at the start, then the parameters."""
    rates, state, numbers = machine_code(system.rhs), tuple_loader(system.size), tuple_loader(system.parameters)

    @jit
    def rhs(c, t, y):
        f = np.array(rates((c[0] + t,) + state(y, 0), numbers(c, 1)))  # noqa: RUF005 - compiled code does not unpack
        if not math.isfinite(f.sum()):  # SciPy would try steps of NaN for ever
            raise OverflowError
        return f

    return rhs


class Solver:
    """One of SciPy's classes under the name of a method."""

    def __init__(self, name: str, scipys: Any):
        self.name, self.scipys = name, scipys

    def runner(self, top: Problem, *, rtol: float = 1e-9, atol: float = 1e-12) -> Run:
        """Natural steps with the local error kept below atol + rtol |y_i|."""
        rtol, atol = check_tolerances(rtol, atol)
        f, c = right_hand_side(top.system), np.array([top.start, *top.numbers])
        with contextlib.suppress(ArithmeticError):  # a potential may have no value at x = 0
            f(c, 0.0, np.zeros(top.system.size))  # compile

        def run(y: Array, grid: Array, work: Work) -> Array:
            try:
                with np.errstate(all="ignore"):
                    solver = self.scipys(lambda t, y: f(c, t, y), 0.0, y, grid[-1], rtol=rtol, atol=atol)
                    return self.on_its_level(top, y, self.steps(solver, grid, work))
            except OverflowError:
                reason = "the state left the range of floating-point numbers"
            except (ArithmeticError, ValueError) as error:
                reason = f"SciPy: {error}"
            raise StepError(self.name, reason, step=work.steps)

        return run

    def on_its_level(self, top: Problem, y: Array, out: Array) -> Array:
        """Return the states `out`, or refuse them if one has lost its energy: a pole of the potential may lie within a step."""
        if kinds.top(top) and not kinds.uniform(top):
            off = np.abs(top.invariants(out)[:, 0] - top.invariants(y)[0])
            if not np.all(off <= top.invariant_scales(y)[0]):
                reason = "rtol and atol do not hold this state: its energy is off by the size of its terms"
                raise StepError(self.name, reason)
        return out

    def steps(self, solver: Any, grid: Array, work: Work) -> Array:
        out = np.empty((len(grid), len(solver.y)))
        size, done = np.abs(grid), 0
        while solver.status == "running":
            evaluations, start = solver.nfev, solver.t
            message = solver.step()
            work.rejected += (solver.nfev - evaluations) // solver.n_stages - 1
            if solver.status == "failed" or solver.t == start:
                raise StepError(self.name, f"SciPy: {message or 'no progress'} (t = {solver.t:g})", step=work.steps)
            work.steps += 1
            reached = int(np.searchsorted(size[:-1], abs(solver.t), side="right"))
            if reached > done:
                out[done:reached] = solver.dense_output()(grid[done:reached]).T
                done = reached
        out[-1] = solver.y  # not interpolated: the last step ends at the last time
        work.rhs_evals += solver.nfev
        return out


def natural(solver: Solver, label: str, order: int, source: str) -> Method:
    """The record of a solver."""
    prepare, evaluate = dense(solver.name, solver.runner)
    return Method(
        name=solver.name,
        label=label,
        family="runge-kutta",
        order=order,
        claims=Claims(conserves={"J3"}),
        control="tolerance",
        source=f"scipy.integrate.{solver.scipys.__name__}; {source}",
        prepare=prepare,
        evaluate=evaluate,
        needs="rhs",
        engine="scipy",
    )


RK45 = natural(
    Solver("rk45", scipy.integrate.RK45), "RK45 (SciPy)", 5, "Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19"
)
DOP853 = natural(
    Solver("scipy_dop853", scipy.integrate.DOP853),
    "DOP853 (SciPy)",
    8,
    "Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), II.5",
)
