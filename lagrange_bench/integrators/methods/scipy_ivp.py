"""SciPy's RK45 on its natural steps. h is only the output grid, which dense output fills.

It is used as it is, with a compiled right-hand side. The step itself is interpreted Python: `rk45_fixed` shows what the formula
costs when it is compiled. J3, whose derivative vanishes, is conserved.

The local error is kept below atol + rtol |y_i|, as a root mean square over the components. SciPy counts the right-hand sides;
the number of rejected steps follows from the number of stages.

Sources: Dormand & Prince, J. Comput. Appl. Math. 6 (1980) 19; Virtanen et al., Nature Methods 17 (2020) 261.
"""

import contextlib
import math
from functools import cache

import numpy as np
import scipy.integrate

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Run, dense
from lagrange_bench.integrators.methods.dop853 import check_tolerances
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System


@cache
def right_hand_side(system: System) -> Compiled:
    """(c, t, y) → y' of any system; c : the time at the start, then the parameters."""
    rates, state, numbers = machine_code(system.rhs), tuple_loader(system.size), tuple_loader(system.parameters)

    @jit
    def rhs(c, t, y):
        f = np.array(rates((c[0] + t, *state(y, 0)), numbers(c, 1)))
        if not math.isfinite(f.sum()):  # SciPy would try steps of NaN for ever
            raise OverflowError
        return f

    return rhs


def runner(top: Problem, *, rtol: float = 1e-9, atol: float = 1e-12) -> Run:
    """Natural steps with the local error kept below atol + rtol |y_i|."""
    rtol, atol = check_tolerances(rtol, atol)
    f, c = right_hand_side(top.system), np.array([top.start, *top.numbers])
    with contextlib.suppress(ArithmeticError):  # a potential may have no value at x = 0
        f(c, 0.0, np.zeros(top.system.size))  # compile

    def run(y: Array, grid: Array, work: Work) -> Array:
        try:
            with np.errstate(all="ignore"):
                solver = scipy.integrate.RK45(lambda t, y: f(c, t, y), 0.0, y, grid[-1], rtol=rtol, atol=atol)
                return dense_output(grid, solver, work)
        except OverflowError:
            reason = "the state left the range of floating-point numbers"
        except (ArithmeticError, ValueError) as error:
            reason = f"SciPy: {error}"
        raise StepError("rk45", reason, step=work.steps)

    return run


def dense_output(grid: Array, solver: scipy.integrate.RK45, work: Work) -> Array:
    """The states at the times of a grid, by dense output."""
    out = np.empty((len(grid), len(solver.y)))
    size, row = np.abs(grid), 0
    while solver.status == "running":
        evaluations, start = solver.nfev, solver.t
        message = solver.step()
        work.rejected += (solver.nfev - evaluations) // solver.n_stages - 1
        if solver.status == "failed" or solver.t == start:
            raise StepError("rk45", f"SciPy: {message or 'no progress'} (t = {solver.t:g})", step=work.steps)
        work.steps += 1
        next_row = int(np.searchsorted(size[:-1], abs(solver.t), side="right"))
        if next_row > row:
            out[row:next_row] = solver.dense_output()(grid[row:next_row]).T
            row = next_row
    out[-1] = solver.y  # not interpolated: the last step ends at the last time
    work.rhs_evals += solver.nfev
    return out


PREPARE, EVALUATE = dense("rk45", runner)
RK45 = Method(
    name="rk45",
    label="RK45 (SciPy)",
    family="runge-kutta",
    order=5,
    claims=Claims(conserves={"J3"}),
    control="tolerance",
    source="scipy.integrate.RK45; Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19",
    prepare=PREPARE,
    evaluate=EVALUATE,
    needs="rhs",
    engine="scipy",
)
