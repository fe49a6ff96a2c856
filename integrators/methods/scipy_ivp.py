"""SciPy's integrators on their natural steps: RK45, DOP853, LSODA and Radau; h is only the output grid, which dense output fills.

They are used as they stand, with a compiled right-hand side and, for the two implicit ones, a compiled Jacobian. Of the 5 to
150 µs of a step nearly all is interpretation: `rk45_fixed` and `dop853` show what the formulas cost without it. J3, whose
derivative vanishes, is kept.

The local error is kept below atol + rtol |y_i|, root mean square over the components. Radau's estimate is of third order: it
achieves more than it is asked for, hence a default of its own. The two implicit ones work in units, powers of two, in which |x|
and |J| + √(|alpha||x|) are of order one: on tops of extreme size Radau would hardly move, and LSODA not start.

SciPy counts the right-hand sides. Rejected steps follow from the number of stages for the explicit pairs; for LSODA and Radau
from the times, one and three to a trial, at which they ask for a right-hand side (a repetition with a fresh Jacobian is the same
trial).

LSODA tells of a failure by a warning; here it becomes the reason of the StepError. Before SciPy 1.17 it is Fortran with one
state for the whole process, and may print to standard output when a step vanishes beside t; so threads take turns, which
the filter of warnings, one for the process too, asks for anyway.

Sources: Dormand & Prince, J. Comput. Appl. Math. 6 (1980) 19; Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations
I (1993), II.5; Petzold, SIAM J. Sci. Stat. Comput. 4 (1983) 136; Hairer & Wanner, Solving Ordinary Differential Equations II
(1996), IV.8; Virtanen et al., Nature Methods 17 (2020) 261.
"""

from __future__ import annotations

import contextlib
import math
import threading
import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import scipy.integrate
from scipy.linalg import LinAlgWarning

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import take
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Problem, Run, dense
from lagrange_bench.integrators.methods.dop853 import check_tolerances
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units, ldexp, units_of

IN_TURNS = threading.Lock()


@cache
def functions(system: System) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """(c, t, y) → right-hand side and Jacobian of any system, in units of y and of y'.

    `c`: the units, those of y', the time at the start, then the parameters.
    """
    n = system.size
    units, numbers = take(n), take(system.parameters)

    @unrolled
    def rates(t, y, q, unit, rate):
        values = system.rhs(t, *(u * v for u, v in zip(unit, y, strict=True)), *q)
        return tuple(v / r for v, r in zip(values, rate, strict=True))

    @unrolled
    def slopes(t, y, q, unit, rate):
        """The derivatives by y, row by row."""
        values = system.jacobian(t, *(u * v for u, v in zip(unit, y, strict=True)), *q)
        return tuple(values[n * k + i] * unit[k] / rate[i] for i in range(n) for k in range(n))

    @jit
    def rhs(c, t, y):
        f = np.array(rates(c[2 * n] + t, units(y, 0), numbers(c, 2 * n + 1), units(c, 0), units(c, n)))
        if not math.isfinite(f.sum()):  # SciPy would try steps of NaN for ever
            raise OverflowError
        return f

    @jit
    def jacobian(c, t, y):
        values = slopes(c[2 * n] + t, units(y, 0), numbers(c, 2 * n + 1), units(c, 0), units(c, n))
        return np.array(values).reshape(n, n)

    return rhs, jacobian


class Solver:
    """One of SciPy's classes under the name of a method. `times`, of an implicit one: how many a trial asks for."""

    def __init__(self, name: str, scipys: Any, times: int = 0):
        self.name, self.scipys, self.times = name, scipys, times

    def runner(self, top: Problem, *, rtol: float, atol: float) -> Run:
        """Natural steps with the local error kept below atol + rtol |y_i|."""
        rtol, atol = check_tolerances(rtol, atol)
        follow = self.implicit if self.times else self.explicit
        f, c, matrix = functions_of(top)
        for function in (f, matrix) if self.times else (f,):
            with contextlib.suppress(ArithmeticError):  # a potential may have no value at x = 0
                function(c, 0.0, np.zeros(top.system.size))  # compile

        def run(y: Array, grid: Array, work: Work) -> Array:
            try:
                with np.errstate(all="ignore"):
                    return self.on_its_level(top, y, follow(top, y, grid, work, rtol, atol))
            except OverflowError:
                reason = "the state left the range of floating-point numbers"
            except (ArithmeticError, ValueError, Warning) as error:
                reason = f"SciPy: {error}"
            raise StepError(self.name, reason, step=work.steps)

        return run

    def on_its_level(self, top: Problem, y: Array, out: Array) -> Array:
        """The states, if none has lost its energy: a pole of the potential may lie within a step."""
        if "force" in top.offers and "uniform" not in top.offers:  # of other problems H may depend on t
            off = np.abs(top.invariants(out)[:, 0] - top.invariants(y)[0])
            if not np.all(off <= top.invariant_scales(y)[0]):
                reason = "rtol and atol do not hold this state: its energy is off by the size of its terms"
                raise StepError(self.name, reason)
        return out

    def explicit(self, top: Problem, y: Array, grid: Array, work: Work, rtol: float, atol: float) -> Array:
        f, c, _ = functions_of(top)
        solver = self.scipys(lambda t, y: f(c, t, y), 0.0, y, grid[-1], rtol=rtol, atol=atol)
        return self.steps(solver, grid, work)

    def implicit(self, top: Any, y: Array, grid: Array, work: Work, rtol: float, atol: float) -> Array:
        units = units_of(self.name, top, y, float(grid[-1])) if "force" in top.offers else None
        slope, c, matrix = functions_of(top, units)
        times = np.array([units.time(t) for t in grid.tolist()]) if units else grid
        tried: set[float] = set()

        def f(t: float, y: Array) -> Any:
            tried.add(t)
            return slope(c, t, y)

        def jac(t: float, y: Array) -> Any:
            return matrix(c, t, y)

        with IN_TURNS, warnings.catch_warnings():
            warnings.filterwarnings("error", message="lsoda")
            warnings.filterwarnings("error", category=LinAlgWarning)
            small, state = np.full(len(y), atol), y
            if units:
                small, state = units.enter(small), units.enter(y)
            solver = self.scipys(f, 0.0, state, times[-1], jac=jac, rtol=rtol, atol=small)
            states = self.steps(solver, times, work, tried)
            return units.leave(states) if units else states

    def steps(self, solver: Any, grid: Array, work: Work, tried: set[float] | None = None) -> Array:
        out = np.empty((len(grid), len(solver.y)))
        size, done = np.abs(grid), 0
        while solver.status == "running":
            evaluations, start = solver.nfev, solver.t
            if tried is None:
                message = solver.step()
                work.rejected += (solver.nfev - evaluations) // solver.n_stages - 1
            else:
                tried.clear()
                message = solver.step()
                work.rejected += max(-(-len(tried - {start}) // self.times) - 1, 0)
            if solver.status == "failed" or solver.t == start:
                at = f" (t = {solver.t:g})" if tried is None else ""  # else in other units
                raise StepError(self.name, f"SciPy: {message or 'no progress'}{at}", step=work.steps)
            work.steps += 1
            reached = int(np.searchsorted(size[:-1], abs(solver.t), side="right"))
            if reached > done:
                out[done:reached] = solver.dense_output()(grid[done:reached]).T
                done = reached
        out[-1] = solver.y  # the last step ends at the last time: no interpolation
        work.rhs_evals += solver.nfev
        return out


def functions_of(top: Problem, units: Units | None = None) -> tuple[Callable[..., Any], Any, Callable[..., Any]]:
    """Right-hand side, what it takes besides time and state, and Jacobian; in units of order one or in the user's."""
    n, rate, length = top.system.size, 0, 0
    if "uniform" in top.offers and units:  # its equations have one form in all units
        top = LagrangeTop(units.alpha)
    elif units:
        rate, length = units.rate, units.length
    powers = (rate,) * 3 + (length,) * 3 if n == 6 else (0,) * n
    c = [*(ldexp(1.0, p) for p in powers), *(ldexp(1.0, p + rate) for p in powers), top.start, *top.numbers]
    f, matrix = functions(top.system)
    return f, np.array(c), matrix


def natural(
    solver: Solver, label: str, family: str, order: int, source: str, tolerances: tuple[float, float] = (1e-9, 1e-12)
) -> Method:
    """The record of a solver; `tolerances` are its defaults, rtol and atol."""
    rtol, atol = tolerances
    prepare, evaluate = dense(solver.name, partial(solver.runner, rtol=rtol, atol=atol))
    return Method(
        name=solver.name, label=label, family=family, order=order, conserves=frozenset({"J3"}), control="tolerance",
        source=f"scipy.integrate.{solver.scipys.__name__}; {source}", prepare=prepare, evaluate=evaluate, needs="rhs",
        engine="scipy",
    )  # fmt: skip


RK45 = natural(
    Solver("rk45", scipy.integrate.RK45), "RK45 (SciPy)", "runge-kutta", 5,
    "Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19",
)  # fmt: skip
DOP853 = natural(
    Solver("scipy_dop853", scipy.integrate.DOP853), "DOP853 (SciPy)", "runge-kutta", 8,
    "Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), II.5",
)  # fmt: skip
LSODA = natural(
    Solver("lsoda", scipy.integrate.LSODA, times=1), "LSODA (SciPy)", "implicit",
    12,  # the highest of its Adams formulas; BDF up to 5
    "Petzold, SIAM J. Sci. Stat. Comput. 4 (1983) 136",
)  # fmt: skip
RADAU = natural(
    Solver("radau", scipy.integrate.Radau, times=3), "Radau (SciPy)", "implicit", 5,
    "Hairer and Wanner, Solving Ordinary Differential Equations II (1996), IV.8", tolerances=(1e-7, 1e-10),
)  # fmt: skip
