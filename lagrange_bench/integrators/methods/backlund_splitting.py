"""The exact step inside a splitting: for a top in a weak potential V beside its weight.

    H = A + B,    A = |J|²/2 + alpha x3,    B = V(x)

The flow of A is a Bäcklund step, exact for any length. The flow of B is a kick, because x is constant. The maps of Wisdom and
Holman do the same with Kepler's motion. The step has to follow V only, not the top, and its errors have a factor ε, the size
of V.

A kick leaves the torus, so λ(h) changes with every step. It is a function of (H, J3) of A, which move in a small box. A table,
made once, gives λ and m as four polynomials in H and J3. One step of Newton's method then puts m on the curve m² = Q(λ), so the
map keeps the invariants to round-off. Outside of the box λ(h) is computed in place (`torus.plain_step`), as everywhere if no
table of degree 12 has all digits. A flow too long for that is taken in parts.

Schemes, A B A … B A, and their errors, if the frequencies of V along the motion are well below 2π/h:

strang      one flow a step, with a `modified_kick`, and a `corrector` at both ends of the run and at every recorded row: ε²h⁴
processed6  two kicks and a flow back between them, with both corrections and one more of each kind: ε²h⁶
aba864      seven kicks and nothing at the ends, for states that are recorded often: εh⁸ + ε²h⁶ + ε³h⁴

V may depend on t: a kick takes V at the time that the flows before it have reached. With `tol` in place of h the step is halved
until two runs agree (`step_halving`).

Every map here is Poisson and symmetric, and C1 and C2 are pinned. It is Poisson only if the table has all digits: a step of time
T(H, J3) and turn Θ(H, J3) is Poisson only if ∂T/∂J3 = ∂Θ/∂H. docs/perturbed.md derives all of it.

Sources: Wisdom & Holman, Astron. J. 102 (1991) 1528; Wisdom, Holman & Touma, Fields Inst. Commun. 10 (1996) 217 (correctors);
Blanes, Casas, Farrés, Laskar, Makazaga & Murua, Appl. Numer. Math. 68 (2013) 58 (aba864). The exact step as the flow of A, its
table, this corrector: this project.
"""

import math
from functools import partial
from itertools import pairwise

import numpy as np

from lagrange_bench.integrators.checks import check_choice, check_flag
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Stepper, Work
from lagrange_bench.integrators.methods import backlund, step_halving
from lagrange_bench.integrators.methods import backlund_kernel as kernels
from lagrange_bench.integrators.methods.backlund_schemes import PROCESSED, SCHEMES, Scheme, ends_of
from lagrange_bench.integrators.methods.backlund_step_size import (
    NAME,
    highest_frequency,
    longest_step,
    nutation_period,
    top_without_V,
    warn_long,
    warn_strong,
)
from lagrange_bench.integrators.methods.dense import at_times, check_tolerance
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.torus.real_map import OFF_TORUS
from lagrange_bench.integrators.torus.step_table import tables

TOLERANCE = 1e-9


class ExactSplittingStepper(loops.ConjugateStepper):
    """Repeats a conjugate of the scheme. States enter and leave through its first flow and its corrector.

    elapsed : the time from the problem's start to the start of this run, if V depends on time.
    """

    def __init__(
        self,
        problem: Problem,
        y0: Array,
        h: float,
        scheme: Scheme,
        has_corrector: bool,
        has_modified_kick: bool,
        elapsed: float = 0.0,
    ):
        (alpha, V), start = problem.alpha_and_rest, problem.start + elapsed
        conserves_J3, timed, n = 2 in V.constant, V.timed, len(scheme.b)
        J, x = y0[:3], y0[3:]
        times = ((scheme.a[0] + scheme.a[-1]) * h, *(a * h for a in scheme.a[1:-1]))
        gradients = (1 + bool(scheme.d)) if has_modified_kick else 0
        # the kernel's state is behind the user's, by the first flow
        groups, kick_time = np.zeros((n, kernels.GROUP)), -scheme.a[0] * h
        for g, time in enumerate(times):
            kick_time += time
            kick_W = scheme.c[g] * -(h * h * h) if gradients > 0 else 0.0
            kick_Z = scheme.d[g] * (h * h * h * h * h) if gradients > 1 else 0.0
            groups[g] = time, scheme.b[g] * h, kick_W, kick_Z, kick_time
        with np.errstate(over="ignore"):  # of a size whose square is no double: refused below
            head = np.array((alpha, x @ x, x @ J, n, h, 0.0, 1.0, 0.0, 1.0, start, *problem.numbers))
        plain_kernel = loops.Kernel(kernels.kernel(V, 0, 0), failures=kernels.FAILURES, timed=timed)
        self.degree = 0  # of the tables, 0 for none
        if kernels.set_box(head, top_without_V(problem).scales(y0), y0, plain_kernel.step, h):
            torus, box = head[kernels.ALPHA : kernels.C2 + 1], head[kernels.CENTRE_H : kernels.NUMBERS]
            flow_times = tuple(dict.fromkeys(times))  # each once
            self.degree, flow_tables = tables(torus, box, flow_times, conserves_J3)
            if self.degree:
                groups = np.hstack((groups, [flow_tables[flow_times.index(time)] for time in times]))
        c = kernels.constants(head, h, groups)
        if not loops.finite(c):
            raise StepError(NAME, "the coefficients of the step are beyond the range of doubles", h=h)
        preprocess, postprocess = ends_of(scheme, h, has_corrector)
        kernel = loops.Kernel(
            kernels.kernel(V, gradients, self.degree),
            kernels.restorer(conserves_J3),
            kernels.RESTORE_EVERY,
            kernels.FAILURES,
            rhs_per_step=n,
            timed=timed,
        )
        super().__init__(
            NAME,
            h,
            kernel,
            c,
            conversion=plain_kernel.step,
            preprocess=kernels.constants(head, h, preprocess),
            postprocess=kernels.constants(head, h, postprocess),
        )

    def enter(self, y: Array) -> Array:
        J1, J2, J3, x1, x2, x3 = y.tolist()
        c1, c2 = self.constants[kernels.C1 : kernels.C2 + 1].tolist()
        size = math.sqrt(c1) * math.hypot(J1, J2, J3)
        has_C1 = abs(x1 * x1 + x2 * x2 + x3 * x3 - c1) <= OFF_TORUS * c1
        if not (has_C1 and abs(x1 * J1 + x2 * J2 + x3 * J3 - c2) <= OFF_TORUS * size):
            raise StepError(NAME, "C1 or C2 of the state is not that of the state this step was prepared for", h=self.h)
        return super().enter(y)


def prepare(
    problem: Problem,
    y0: Array,
    h: float,
    *,
    scheme: str = "strang",
    corrector: bool | None = None,
    modified_kick: bool | None = None,
) -> Stepper:
    """Kicks by V, and exact flows of the top without V. In a uniform field, V = 0, every scheme is the exact step.

    Parameters
    ----------
    scheme : a name of SCHEMES.
    corrector, modified_kick : True by default for "strang" and "processed6". Other schemes have none.
    """
    check_choice(scheme, "scheme", SCHEMES)
    has_corrector = _has_part("corrector", corrector, scheme)
    has_modified_kick = _has_part("modified_kick", modified_kick, scheme)
    if isinstance(problem, LagrangeTop):
        return backlund.stepper(NAME, problem, y0, h)
    warn_strong(problem, y0)
    warn_long(problem, y0, h)
    return ExactSplittingStepper(problem, y0, h, SCHEMES[scheme], has_corrector, has_modified_kick)


def _has_part(name: str, value: bool | None, scheme: str) -> bool:
    """Whether the steps have a part that only processed schemes offer. value : the option, None for the scheme's default."""
    has_part = scheme in PROCESSED if value is None else check_flag(value, name)
    if has_part and scheme not in PROCESSED:
        raise ValueError(f"{name} belongs to scheme={' or '.join(map(repr, PROCESSED))}; got scheme={scheme!r}")
    return has_part


def evaluate(problem: Problem, y0: Array, times: Array, *, tol: float = TOLERANCE) -> tuple[Array, Work]:
    """The states at any times. The step is halved until two runs agree to `tol` of the scales of J and x: see `step_halving`.

    In a uniform field there is one exact step to each time, whatever `tol`.
    """
    tol = check_tolerance(tol, step_halving.LEAST, step_halving.MOST)
    notes: list[str] = []
    if isinstance(problem, LagrangeTop):
        states, work = backlund.states_at(NAME, problem, y0, times)
        work.notes = "one exact step to each time"
        return states, work
    warn_strong(problem, y0)

    def run(y: Array, grid: Array, work: Work) -> Array:
        if not (problem.timed or np.any(problem.rhs(y))):
            notes.append("an equilibrium: no step is needed")
            return np.tile(y, (len(grid), 1))
        rate, size, unit = problem.scales(y)
        last, parts = float(grid[-1]), math.ceil(step_halving.PLACES / len(grid))
        frequency = highest_frequency(problem, y, np.linspace(0.0, last, step_halving.PLACES))
        longest = 2.0 * min(longest_step(nutation_period(problem, y), frequency), unit)
        track = partial(_track, problem, y, grid, parts, longest, work)
        rows, halvings, difference = step_halving.agreeing_run(NAME, track, tol, (rate, size))
        largest = longest / 2**halvings
        notes.append(
            f"strang, h ≤ {largest:.3g} to t = {last:g}; twice the step makes a difference of {difference:.1e}"
        )
        return rows[parts - 1 :: parts]

    states, work = at_times(NAME, problem, run, y0, times)
    work.notes = "; ".join(notes)
    return states, work


def _track(problem: Problem, y: Array, grid: Array, parts: int, longest: float, work: Work, refinement: int) -> Array:
    """The states at the times of `grid`, and at parts − 1 equidistant times before each. Steps are at most longest/refinement.

    A uniform grid is one run. On another grid a run goes from each time to the next.
    """
    n, last, tracks = len(grid), float(grid[-1]), []
    is_uniform = np.allclose(grid, last * np.arange(1, n + 1) / n, rtol=4 * 2.0**-52, atol=0.0)
    for start, end in [(0.0, last)] if is_uniform else pairwise((0.0, *grid.tolist())):
        rows = (n if is_uniform else 1) * parts
        every = refinement * max(1, math.ceil(abs(end - start) / rows / longest))
        h = (end - start) / (rows * every)
        if h == 0.0:  # h underflows: nothing moves in so short a time
            tracks.append(np.tile(y, (rows, 1)))
            continue
        stepper = ExactSplittingStepper(problem, y, h, SCHEMES["strang"], True, True, start)
        tracks.append(stepper.record(y, rows * every, every)[1:])
        y = tracks[-1][-1]
        for name in ("steps", "rhs_evals", "iterations"):
            setattr(work, name, getattr(work, name) + getattr(stepper.work, name))
    return np.concatenate(tracks)


METHOD = Method(
    name="backlund_splitting",
    label="Bäcklund splitting",
    family="backlund",
    order=4,
    claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
    source="this project; Wisdom and Holman, Astron. J. 102 (1991) 1528; corrector and modified kick: see the module",
    prepare=prepare,
    needs=kinds.driven_top,
    evaluate=evaluate,
)
