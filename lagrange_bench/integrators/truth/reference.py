"""The reference solution, in quadruple precision, of a top in any field or of any problem. It serves where no closed form exists.

    J' = ∇U(x) × x        x' = J × x        H = |J|²/2 + U(x)

Taylor's method runs twice, with different orders and steps. The difference of the two runs estimates the error and is returned.
For a `Problem` whose H depends on time, the time is one more variable. heyoka takes the steps in 128-bit numbers. If it is
missing, or has no such numbers, FLINT takes them, in the interpreter. No method of the bench is used.

The right-hand side is the program of the problem's gradient, with its constants and parameters as exact numbers. (heyoka on its
own would turn a division by a double into a product with the rounded reciprocal.)

Results are cached, in memory and in the folder `reference` of the user's cache directory (LAGRANGE_BENCH_CACHE names another; if
it is empty, there is none). Calls from several threads wait for each other.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99 (order and step); Biscani & Izzo, MNRAS 504 (2021) 2614 (heyoka).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from operator import mul
from pathlib import Path
from typing import Any

import numpy as np
from flint import acb, arb
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array, check_choice, check_times
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape
from lagrange_bench.integrators.interface import StepError
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.units import ldexp, scaled_size
from lagrange_bench.integrators.problem.vectors import cross
from lagrange_bench.integrators.truth.curve import horner
from lagrange_bench.support.files import cache_folder, write_file
from lagrange_bench.support.precision import ONE_AT_A_TIME, workprec

__all__ = ["Reference", "engines", "solution"]

TOLERANCE, CHECK = 1e-33, 1e-29  # of the two runs
BITS = 136  # of FLINT: 40 digits
PAIR = 2.0**-105  # relative error of a number as a pair of doubles
SHORTEST = 1e-12  # least step, in units of the motion; only a singularity needs a shorter one
FARTHEST = 1e9  # longest time, in units of the motion; it takes hours


@dataclass(frozen=True, eq=False)
class Reference:
    """States with an estimate of their errors. The arrays are read-only."""

    states: Array  # (N, n), n = 6 for a top
    tail: Array  # (N, n): states + tail has about 30 digits
    error: (
        Array  # (N,): of states + tail, relative to the scales of its vectors; of `states` alone it is 1.1e-16 larger
    )
    engine: str  # "heyoka" or "flint"


def solution(problem: Problem, y0: ArrayLike, t: ArrayLike, engine: str | None = None) -> Reference:
    """States at times t of the motion that is at y0 at t = 0.

    Parameters
    ----------
    problem, y0 : the problem and a state, (6,) or for a Problem (n,). Their doubles are taken as exact.
    t : times (N,) of any sign, in any order.
    engine : one of `engines()`; None: the first.

    Returns
    -------
    Reference. Look at its `error`: it grows with |t|, on a chaotic orbit exponentially, and may exceed 1.

    Raises
    ------
    ValueError : an argument is malformed, or y0 lies at a singularity of the potential.
    StepError : the motion runs into a singularity; the potential has corners; t is too far to be reached.
    """
    times = check_times(t)
    orbit = Orbit(problem, y0, engine)
    key, n = orbit.key("solution", times.tobytes().hex()), len(orbit.y0)
    table = _cached(key, (len(times), 2 * n + 1), lambda: orbit.compute(times))
    return Reference(table[:, :n], table[:, n : 2 * n], table[:, 2 * n], orbit.engine)


class Orbit:
    """A motion to compute.

    A top is computed in units in which |x| and the rate are between 1/2 and 2. The units are powers of two, so changing them is
    exact. Any other problem is computed in its own units, with the time as one more variable after the state.
    """

    def __init__(self, problem: Any, y0: ArrayLike, engine: str | None = None):
        known = engines()
        self.engine = known[0] if engine is None else check_choice(engine, "engine", known)
        self.problem, self.y0 = problem, problem.check_state(y0)
        self.in_field = kinds.top(problem)
        if "smooth" not in problem.offers:
            reason = f"{problem.description} has corners, roots of squares, and no series goes on there"
            raise StepError("reference", f"there is no reference solution: {reason}")
        self.clock, self.exponents = 0, np.zeros(len(self.y0), dtype=int)
        if self.in_field:
            powers = [round(math.log2(v)) if 0.0 < v < math.inf else 0 for v in problem.scales(self.y0)[:2]]
            self.clock, self.exponents = powers[0], np.repeat(powers, 3)

    def key(self, kind: str, *settings: str) -> bytes:
        problem = self.problem
        numbers = map(float.hex, (problem.start, *problem.numbers, *self.y0.tolist()))
        words = (_version(), kind, self.engine, _formulas(problem.system).digest, *numbers, *settings)
        return hashlib.sha256("\n".join(words).encode()).digest()

    def runner(self, tolerance: float) -> Any:
        program, parameters = clocked(self.problem.system), self.problem.numbers
        if self.in_field:
            size = int(self.exponents[3])
            units = ldexp(1.0, size), ldexp(1.0, size - 2 * self.clock)
            if not all(0.0 < unit < math.inf for unit in units):
                raise ValueError(
                    "y0 and the potential are too large or too small: choose less extreme units of time and length"
                )
            program, parameters = equations(_formulas(self.problem.system)), (*units, *parameters)
        return {"heyoka": Heyoka, "flint": Flint}[self.engine](program, parameters, tolerance)

    def compute(self, times: Array) -> Array:
        """Rows of states, tails and errors, from the two runs."""
        rows = np.array([self.run(tolerance, times) for tolerance in (TOLERANCE, CHECK)])
        if not np.all(np.isfinite(rows)):
            raise StepError("reference", "the motion leaves the range of doubles")
        difference = np.sum(rows[0] - rows[1], axis=1)  # of the heads, and of the tails
        return np.column_stack((rows[0, :, 0], rows[0, :, 1], scaled_size(self.problem, self.y0, difference) + PAIR))

    def run(self, tolerance: float, times: Array) -> Array:
        """States (N, 2, n), as heads and tails."""
        end = float(np.max(np.abs(times), initial=0.0))
        if ldexp(end, self.clock) > FARTHEST:
            raise StepError(
                "reference", f"|t| = {end:g} is over {FARTHEST:g} time scales: more steps than can be taken"
            )
        start = np.array((np.ldexp(self.y0, -self.exponents), np.zeros(len(self.y0))))
        if not self.in_field:
            start = np.column_stack((start, (self.problem.start, 0.0)))
        out = np.empty((len(times), *start.shape))
        runner = self.runner(tolerance)
        for sign in (1, -1):
            later = np.flatnonzero(sign * times > 0)
            grid, places = np.unique(np.ldexp(sign * times[later], self.clock), return_inverse=True)  # in order
            try:
                if len(grid):
                    out[later] = runner.states(start, sign * grid)[places]
            except Singularity as error:
                time = error.args[0]  # NaN if the first step fails
                at = f" at t = {math.ldexp(time, -self.clock):g}" if math.isfinite(time) else ""
                raise StepError("reference", f"the motion runs into a singularity{at}") from None
        out[times == 0] = start
        with np.errstate(over="ignore"):
            return np.ldexp(out[:, :, : len(self.y0)], self.exponents)


def _formulas(system: System) -> System:
    """The system without its list of conserved components, so that the key of the cache does not depend on the list."""
    return replace(system, constant=frozenset())


@lru_cache(maxsize=64)
def clocked(system: System) -> Program:
    """A program of the rates of a state and of the time, as functions of the state, the time and the parameters."""
    tape = Tape()
    *y, t = (tape.input() for _ in range(system.size + 1))
    rates = tape.run(system.rhs, t, *y, *(tape.input() for _ in range(system.parameters)))
    return tape.program((*rates, tape.constant(1.0)))


@lru_cache(maxsize=64)
def equations(system: System) -> Program:
    """A program of the rates of J and x, as functions of J, x, two units and the parameters, of |J|²/2 + U(x).

    In the orbit's units x is size·x and U is weight·U.
    """
    tape = Tape()
    J, x = ([tape.input() for _ in range(3)] for _ in range(2))
    size, weight, *parameters = (tape.input() for _ in range(2 + system.parameters))
    g = system.force(tape, 0.0, [size * v for v in x], parameters)
    return tape.program((*cross([weight * part for part in g], x), *cross(J, x)))


# ---------------------------------------------------------------- engines: states (N, 2, n), heads and tails, at times (N,)


@cache
def engines() -> tuple[str, ...]:
    """The engines that are installed here, the best first."""
    try:
        import heyoka
    except ImportError:
        return ("flint",)
    return ("heyoka", "flint") if hasattr(heyoka, "real128") else ("flint",)


class Singularity(Exception):
    """Steps have become too short or impossible. The argument is the time."""


class Heyoka:
    """Steps in IEEE 128-bit numbers, 34 digits."""

    def __init__(self, program: Program, parameters: Sequence[float], tolerance: float):
        import heyoka as hy

        self.real, self.outcome = hy.real128, hy.taylor_outcome
        self.integrator = compiled(program, tolerance)
        self.parameters = np.array(parameters)

    def states(self, start: Array, times: Array) -> Array:
        """States at `times`, which lead away from 0 in one direction, from `start` at 0."""
        ta = self.integrator
        grid = np.append(0.0, times).astype(self.real)
        ta.time, end = grid[0], grid[-1]
        ta.state[:] = self.quadruple(start)
        ta.pars[:] = self.quadruple((self.parameters[: len(ta.pars)],))  # the last ones may be in no formula

        def go_on(ta: Any) -> bool:  # the call also lets Ctrl-C in
            return abs(float(ta.last_h)) > SHORTEST or ta.time == end

        outcome, *_, states = ta.propagate_grid(grid, callback=go_on)
        if outcome != self.outcome.time_limit:
            raise Singularity(float(ta.time))
        head = states[1:].astype(float)
        return np.stack((head, (states[1:] - self.quadruple((head,))).astype(float)), axis=1)

    def quadruple(self, parts: Sequence[Array] | Array) -> NDArray[Any]:
        """The sum of arrays of doubles."""
        return np.sum([part.astype(self.real) for part in parts], axis=0)


@lru_cache(maxsize=16)
def compiled(program: Program, tolerance: float) -> Any:
    """heyoka's integrator. It keeps a state; each run sets all of it."""
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    n = len(program.outputs)
    variables = hy.make_vars(*(f"y{i}" for i in range(n)))
    rates = program.python(lambda value: hy.expression(hy.real128(value)))
    system = list(zip(variables, rates(*variables, *(hy.par[i] for i in range(program.inputs - n))), strict=True))
    zero = hy.real128(0.0)
    # unrolled code would take seconds to compile and is not faster here
    return hy.taylor_adaptive(
        system,
        [zero] * n,
        tol=hy.real128(tolerance),
        fp_type=hy.real128,
        compact_mode=True,
    )


class Flint:
    """Steps in FLINT, with 40 digits: the same Taylor series, in the interpreter. Radii of balls do not count."""

    def __init__(self, program: Program, parameters: Sequence[float], tolerance: float):
        self.program, self.parameters = program, parameters
        self.order = math.ceil(1 - math.log(tolerance) / 2)

    def states(self, start: Array, times: Array) -> Array:
        """As `Heyoka.states`."""
        n = len(self.program.outputs)
        out = np.empty((len(times), 2, n))
        with workprec(BITS):
            y, now = [arb(a) + arb(b) for a, b in start.T.tolist()], arb(0)
            wanted = [arb(t) for t in times.tolist()]
            done, backward = 0, wanted[-1] < 0
            while done < len(wanted):
                series = coefficients(self.program, y, self.parameters, self.order)
                h = self.step(series)
                if not h > SHORTEST:
                    raise Singularity(float(now))
                while done < len(wanted) and abs(wanted[done] - now) <= h:
                    for i, c in enumerate(series):
                        value = horner(c, wanted[done] - now).mid()
                        out[done, :, i] = float(value), float(value - float(value))
                    done += 1
                h = -h if backward else h
                y, now = [horner(c, arb(h)).mid() for c in series], (now + h).mid()
        return out

    def step(self, series: list[list[arb]]) -> float:
        """The step for which the last two terms are below the tolerance: their radius of convergence over e²; or NaN."""
        p = self.order
        if not all(c[p].is_finite() for c in series):
            return math.nan
        size, *last = (max(float(abs(c[k])) for c in series) for k in (0, p - 1, p))
        radii = [(max(size, 1.0) / c) ** (1 / k) for c, k in zip(last, (p - 1, p), strict=True) if c]
        return min([*radii, 1e6]) * math.exp(-2 - 0.7 / (p - 1))


def coefficients(program: Program, y: Sequence[arb], parameters: Sequence[float], order: int) -> list[list[arb]]:
    """Taylor coefficients of each component of y from 0 to `order`; not finite at a singularity."""
    states = [[v] for v in y]
    values = [*states, *([arb(p)] for p in parameters)]  # of each place a series; of a constant, one number
    lines: list[tuple[str, list[arb], list[arb], list[arb]]] = []

    def series(place: Any) -> list[arb]:
        return [arb(place[1])] if isinstance(place, tuple) else values[place]

    constant = [i >= len(states) for i in range(len(values))]
    for operation, *arguments in program.lines:
        a, b, new = series(arguments[0]), series(arguments[-1]), list[arb]()
        if operation in ("sin", "cos"):
            b = []  # for exp(i a)
        constant.append(all(isinstance(place, tuple) or constant[place] for place in arguments))
        if constant[-1]:
            _append(operation, a, b, new, 0)
        else:
            lines.append((operation, a, b, new))
        values.append(new)
    rates = [series(place) for place in program.outputs]
    for k in range(order):
        for line in lines:
            _append(*line, k)
        for state, rate in zip(states, rates, strict=True):
            state.append(rate[k] / (k + 1) if k < len(rate) else arb(0))
    return states


def _append(operation: str, a: list[arb], b: list[arb], c: list[arb], k: int) -> None:
    """Append coefficient k of c = a ∘ b, or of c = ∘a, computed from lower ones. A constant has only the first.

    a b: c_k = Σ a_j b_(k−j)      a/b: b_0 c_k = a_k − Σ b_j c_(k−j)      √a: 2 c_0 c_k = a_k − Σ c_j c_(k−j)
    exp a: k c_k = Σ j a_j c_(k−j)      log a: a_0 c_k = a_k − Σ j c_j a_(k−j)/k      sin a, cos a: parts of b = exp(i a)
    """
    if operation in ("add", "sub", "neg"):
        one, two = (v[k] if k < len(v) else arb(0) for v in (a, b))
        c.append(one + two if operation == "add" else one - two if operation == "sub" else -one)
    elif operation == "mul":
        c.append(a[0] * b[k] if len(a) <= k else a[k] * b[0] if len(b) <= k else sum(map(mul, a, b[k::-1]), arb(0)))
    elif operation == "div":
        known = sum(map(mul, b[1 : k + 1], c[::-1]), arb(0)) if k else arb(0)
        c.append(((a[k] if k < len(a) else arb(0)) - known) / b[0])
    elif operation in ("exp", "sin", "cos"):
        power: list[Any] = c if operation == "exp" else b
        i = 1 if operation == "exp" else acb(0, 1)
        slope = sum((j * a[j] * power[k - j] for j in range(1, min(k + 1, len(a)))), arb(0))
        power.append(slope * i / k if k else (i * a[0]).exp())
        if operation != "exp":
            c.append(power[k].imag if operation == "sin" else power[k].real)
    elif operation == "log":
        known = sum((j * c[j] * a[k - j] for j in range(max(1, k - len(a) + 1), k)), arb(0))
        c.append(((a[k] if k < len(a) else arb(0)) - known / k) / a[0] if k else a[0].log())
    elif k == 0:
        c.append(a[0].sqrt())
    else:
        known = sum(map(mul, c[1:], c[:0:-1]), arb(0))
        c.append((a[k] - known) / (2 * c[0]))


# ---------------------------------------------------------------- the cache


@cache
def _version() -> str:
    """The version of the algorithm: a digest of this file."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


_memory: dict[bytes, Array] = {}
MOST_TABLES = 256  # results in memory


def _cached(key: bytes, shape: tuple[int, ...], compute: Callable[[], Array]) -> Array:
    """The table with this key, from memory, from disk or computed now; read-only.

    A file begins with a digest of the key and of the table's bytes, which follow. A damaged file is written again.
    """
    with ONE_AT_A_TIME:  # the engines have a state
        if key not in _memory:
            folder = cache_folder()
            place = None if folder is None else folder / "reference" / key.hex()
            table = None if place is None else _stored(place, key, shape)
            if table is None:
                table = np.ascontiguousarray(compute(), dtype="<f8")
                payload = table.tobytes()
                with suppress(OSError):  # a full or read-only disk: the result is there all the same
                    if place is not None:
                        write_file(place, hashlib.sha256(key + payload).digest() + payload)
            table.flags.writeable = False
            while len(_memory) >= MOST_TABLES:
                del _memory[next(iter(_memory))]
            _memory[key] = table
        return _memory[key]


def _stored(place: Path, key: bytes, shape: tuple[int, ...]) -> Array | None:
    try:
        content = place.read_bytes()
    except OSError:  # there is none
        return None
    seal, payload = content[:32], content[32:]
    if seal != hashlib.sha256(key + payload).digest():
        return None
    return np.frombuffer(payload, dtype="<f8").reshape(shape)
