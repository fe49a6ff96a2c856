"""The reference solution of a top in any field: numerical, in quadruple precision, and checked against itself.

    J' = ∇U(x) × x        x' = J × x        H = |J|²/2 + U(x)

has no closed form in general. Two runs of Taylor's method with different orders and steps give one solution; their
difference is the estimate of its error and is returned with it. heyoka takes the steps in 128-bit numbers; where it is
missing, or has no such numbers, mpmath takes them, about 50 times slower. No method of the bench is used.

The potential's gradient is recorded once, as a list of operations + − × ÷ and powers. Both engines, and the derivatives for
the Lyapunov exponent, are made from this list. Its numbers are the problem's doubles, taken as exact: heyoka on its own
would turn a division by a number into a product with the rounded reciprocal.

Results are kept, in memory and in the folder `reference` of the user's cache directory (LAGRANGE_BENCH_CACHE moves it,
empty switches it off). Neither engine may be called from several threads at once.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99 (order and step); Biscani & Izzo, MNRAS 504 (2021) 2614 (heyoka); Benettin,
Galgani, Giorgilli & Strelcyn, Meccanica 15 (1980) 9 and 21 (the Lyapunov exponent).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, reduce
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mpmath import mp, mpf
from numpy.typing import ArrayLike, NDArray

from integrators.checks import check_choice, check_real, check_state, check_times
from integrators.files import cache_folder, write_file
from integrators.interface import StepError
from integrators.truth.exact import rounded_off

__all__ = ["Problem", "Reference", "after_steps", "engines", "horizon", "lyapunov", "solution"]

Array = NDArray[np.float64]
Node = tuple[Any, ...]  # ("variable", i), ("number", value), (operation, place, place) or ("**", place, exponent)

TOLERANCE, CHECK = 1e-33, 1e-29  # of the two runs
TANGENT = 1e-20  # of a run for the Lyapunov exponent: its growth is wanted to a few digits
DIGITS = 40  # of mpmath
PAIR = 2.0**-105  # what a number loses as a pair of doubles
SHORTEST = 1e-12  # step, in units of the motion: only a singularity asks for less
SEGMENT = 2.0  # units of the motion between two renormalisations of a tangent vector


class Problem(Protocol):
    """What is needed of a problem; `PerturbedTop` has it."""

    @property
    def digest(self) -> str:
        """Stands for the formula of the potential and its numbers: equal digests, equal fields."""
        ...

    def field(self, x1: Any, x2: Any, x3: Any, /) -> tuple[Any, Any, Any]:
        """The gradient of the whole potential, by + − × ÷ and powers (√ is **0.5) of anything that has them."""
        ...

    def scales(self, y: Any, /) -> tuple[float, float, float]:
        """Scales of J, of x and of time, as `LagrangeTop.scales`."""
        ...


@dataclass(frozen=True)
class Reference:
    """States with an estimate of their errors. The arrays are read-only."""

    states: Array  # (N, 6)
    tail: Array  # (N, 6): states + tail has about 30 digits
    error: Array  # (N,): of states + tail, relative to the scales of J and x; rounding adds 1.1e-16 to that of `states`
    engine: str  # "heyoka" or "mpmath"

    @property
    def digits(self) -> int:
        """Decimal digits that the worst of the states has; 0 where a chaotic orbit is lost."""
        worst = float(np.max(self.error, initial=PAIR))
        return max(0, math.floor(-math.log10(worst)))


def solution(problem: Problem, y0: ArrayLike, t: ArrayLike, engine: str | None = None) -> Reference:
    """States at times t of the motion that is at y0 at t = 0.

    Parameters
    ----------
    problem, y0 : the problem and a state (6,). Their doubles are taken as exact.
    t : times (N,) of any sign, in any order.
    engine : one of `engines()`; None for the first.

    Returns
    -------
    Reference. Look at its `error`: it grows with |t|, exponentially on a chaotic orbit, and nothing stops it at 1.

    Raises
    ------
    ValueError : an argument is malformed, or y0 lies at a singularity of the potential.
    StepError : the motion runs into a singularity.
    """
    times = check_times(t)
    return _solution(problem, y0, times, np.zeros_like(times), engine)


def after_steps(problem: Problem, y0: ArrayLike, h: float, counts: ArrayLike, engine: str | None = None) -> Reference:
    """States after n steps of h for n in `counts`: at the times n·h themselves, not at the doubles next to them.

    `counts` are whole numbers up to 2^53, of any sign, in any order; the rest is as in `solution`.
    """
    h, n = check_real(h, "h"), np.asarray(counts)
    if n.ndim != 1 or n.dtype.kind not in "iu" or np.any(np.abs(n) > 2**53):
        raise ValueError("counts must be a sequence of whole numbers up to 2^53")
    n = n.astype(float)
    with np.errstate(over="ignore"):
        times = h * n
    if not np.all(np.isfinite(times)):
        raise ValueError("h times counts must be finite")
    return _solution(problem, y0, times, rounded_off(h, n), engine)


def lyapunov(problem: Problem, y0: ArrayLike, t: float, engine: str | None = None) -> float:
    """The largest Lyapunov exponent up to time t: log(|v(t)|/|v(0)|)/|t| of a tangent vector v, per unit of time.

    v obeys the variational equations along the orbit and starts in one direction that is special in no way; |v| is taken
    in the scales of J and x. Of an orbit that is not chaotic v grows like t: the number is about log(t)/t, and not 0.

    Source: Benettin, Galgani, Giorgilli & Strelcyn, Meccanica 15 (1980) 21.
    """
    t = check_real(t, "t")
    if t == 0.0:
        raise ValueError("t must not be 0")
    orbit = Orbit(problem, y0, engine, tangent=True)

    def compute() -> Array:
        *_, (_, growth) = orbit.growth(t)
        return np.array([growth / abs(t)])

    return float(_kept(orbit.key("lyapunov", t.hex()), (1,), compute)[0])


def horizon(
    problem: Problem, y0: ArrayLike, tolerance: float, longest: float = 1e4, engine: str | None = None
) -> float:
    """The time up to which an error of one ulp in y0 stays below `tolerance`, both relative to the scales of J and x.

    An integrator in doubles can be judged by its errors up to here, by what it conserves beyond. The ulp grows as the
    tangent vector of `lyapunov`; the answer is exact to about two units of the motion. inf if it is beyond `longest`.
    """
    tolerance, longest = check_real(tolerance, "tolerance"), check_real(longest, "longest")
    ulp = 2.0**-52
    if not ulp < tolerance:
        raise ValueError(f"tolerance must be larger than an ulp, 2^-52; got {tolerance:g}")
    if not longest > 0.0:
        raise ValueError(f"longest must be positive; got {longest:g}")
    orbit = Orbit(problem, y0, engine, tangent=True)

    def compute() -> Array:
        before = 0.0
        for time, growth in orbit.growth(longest):
            if growth >= math.log(tolerance / ulp):
                return np.array([before])
            before = time
        return np.array([math.inf])

    return float(_kept(orbit.key("horizon", tolerance.hex(), longest.hex()), (1,), compute)[0])


def _solution(problem: Problem, y0: ArrayLike, times: Array, more: Array, engine: str | None) -> Reference:
    orbit = Orbit(problem, y0, engine)
    key = orbit.key("solution", times.tobytes().hex(), more.tobytes().hex())
    table = _kept(key, (len(times), 13), lambda: orbit.compute(times, more))
    return Reference(table[:, :6], table[:, 6:12], table[:, 12], orbit.engine)


class Orbit:
    """A motion in units where |x| and the rate are between 1/2 and 2: powers of two, so that changing units is exact."""

    def __init__(self, problem: Problem, y0: ArrayLike, engine: str | None, tangent: bool = False):
        y = check_state(y0)
        known = engines()
        self.engine = known[0] if engine is None else check_choice(engine, "engine", known)
        self.problem, self.y0, self.tangent = problem, y, tangent
        self.rate, self.size, _ = problem.scales(y)
        powers = [round(math.log2(v)) if 0.0 < v < math.inf else 0 for v in (self.rate, self.size)]
        self.exponents, self.clock = np.repeat(powers, 3), powers[0]

    def key(self, kind: str, *more: str) -> bytes:
        state = self.y0.tobytes().hex()
        words = (_version(), kind, self.engine, self.problem.digest, state, *more)
        return hashlib.sha256("\n".join(words).encode()).digest()

    def runner(self, tolerance: float) -> Any:
        rate, size = (int(e) for e in self.exponents[2:4])
        equations = record(self.problem.field, math.ldexp(1.0, size), math.ldexp(1.0, size - 2 * rate), self.tangent)
        start = np.ldexp(self.y0, -self.exponents)
        try:
            first = [c[1] for c in coefficients(equations, [mpf(v) for v in start] + [mpf(1)] * 6, 1)]
            regular = all(isinstance(v, mpf) and mp.isfinite(v) for v in first)
        except ZeroDivisionError:
            regular = False
        if not regular:
            raise ValueError(f"y0 lies at a singularity of the potential: its gradient at x = {self.y0[3:].tolist()}")
        return {"heyoka": Heyoka, "mpmath": Mpmath}[self.engine](equations, tolerance)

    def compute(self, times: Array, more: Array) -> Array:
        """Rows of states, tails and errors."""
        rows = np.array([self.run(tolerance, times, more) for tolerance in (TOLERANCE, CHECK)])
        difference = np.sum(rows[0] - rows[1], axis=1)  # of the heads, and of the tails
        if not np.all(np.isfinite(rows)):
            raise StepError("reference", "the motion leaves the range of doubles")
        J, x = (np.linalg.norm(part, axis=1) for part in (difference[:, :3], difference[:, 3:]))
        error = np.maximum(J / (self.rate or 1.0), x / self.size) + PAIR
        return np.column_stack((rows[0, :, 0], rows[0, :, 1], error))

    def run(self, tolerance: float, times: Array, more: Array) -> Array:
        """States (N, 2, 6), heads and tails."""
        start = np.array((np.ldexp(self.y0, -self.exponents), np.zeros(6)))
        out = np.empty((len(times), 2, 6))
        runner = self.runner(tolerance)
        for sign in (1, -1):
            later = np.flatnonzero(sign * times > 0)
            pairs = np.ldexp((sign * times[later], sign * more[later]), self.clock).T
            grid, places = np.unique(pairs, axis=0, return_inverse=True)  # in order
            if len(grid):
                out[later] = self.advance(runner, start, sign * grid)[places.ravel()]
        out[times == 0] = start
        return np.ldexp(out, self.exponents)

    def advance(self, runner: Any, start: Array, times: Array, since: float = 0.0) -> Array:
        try:
            states: Array = runner.states(start, times)
        except Singularity as error:
            time = math.ldexp(since + error.args[0], -self.clock)
            raise StepError("reference", f"the motion runs into a singularity at t = {time:g}") from None
        return states

    def growth(self, t: float) -> Iterator[tuple[float, float]]:
        """Times up to |t| and log(|v|/|v(0)|) there, along the orbit forward or backward."""
        runner = self.runner(TANGENT)
        v = np.cos(np.arange(1.0, 7.0))
        y = np.zeros((2, 12))
        y[0] = (*np.ldexp(self.y0, -self.exponents), *(v / np.linalg.norm(v)))
        total, end = 0.0, math.ldexp(abs(t), self.clock)
        segments = math.ceil(end / SEGMENT)
        for n in range(1, segments + 1):
            length = SEGMENT if n < segments else end - SEGMENT * (segments - 1)
            grid = np.array([[math.copysign(length, t), 0.0]])
            y = self.advance(runner, y, grid, since=math.copysign(SEGMENT * (n - 1), t))[0]
            size = float(np.linalg.norm(y[0, 6:]))
            exponent = math.frexp(size)[1]
            yield math.ldexp(min(n * SEGMENT, end), -self.clock), total + math.log(size)
            y[:, 6:] = np.ldexp(y[:, 6:], -exponent)
            total += exponent * math.log(2)


# ---------------------------------------------------------------- the equations as a list of operations


@dataclass(frozen=True)
class Equations:
    """y' as a list of operations, each on results of earlier ones, and the places of the rates in it."""

    nodes: tuple[Node, ...]
    rates: tuple[int, ...]


def record(field: Callable[..., Any], size: float, weight: float, tangent: bool) -> Equations:
    """The equations of motion for J and x in units of their own: U's gradient is taken at size·x, and times weight.

    With `tangent` the variational equations follow, for the six components of a tangent vector.
    """
    tape = Tape()
    y = [tape.add("variable", i) for i in range(6)]
    J, x = y[:3], y[3:]
    g = [weight * tape.number(part) for part in field(*(size * v for v in x))]
    rates = cross(g, x) + cross(J, x)
    if tangent:
        rates += tape.derivatives(rates, y, [tape.add("variable", 6 + i) for i in range(6)])
    return Equations(tuple(tape.nodes), tuple(r.place for r in rates))


def cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Tape:
    """Operations in the order they were done, each once."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.places: dict[Node, int] = {}

    def add(self, *node: Any) -> Recorded:
        if node not in self.places:
            self.places[node] = len(self.nodes)
            self.nodes.append(node)
        return Recorded(self, self.places[node])

    def number(self, value: Any) -> Recorded:
        if isinstance(value, Recorded):
            return value
        number = float(value)
        if number != value:
            raise ValueError(f"the numbers in a potential must be doubles; got {value!r}")
        return self.add("number", number)

    def derivatives(self, results: Sequence[Recorded], at: Sequence[Recorded], v: Sequence[Recorded]) -> list[Recorded]:
        """Derivatives of `results` at the variables `at` along v, by the rules of calculus for each operation."""
        zero = self.number(0.0)
        d = {a.place: b for a, b in zip(at, v, strict=True)}
        for place, (operation, *rest) in enumerate(list(self.nodes)):
            if operation in ("variable", "number"):
                d.setdefault(place, zero)
                continue
            here, a, da = Recorded(self, place), Recorded(self, rest[0]), d[rest[0]]
            if operation == "**":
                d[place] = rest[1] * here / a * da
                continue
            b, db = Recorded(self, rest[1]), d[rest[1]]
            if operation == "+":
                d[place] = da + db
            elif operation == "-":
                d[place] = da - db
            elif operation == "*":
                d[place] = da * b + a * db
            else:
                d[place] = (da - here * db) / b
        return [d[r.place] for r in results]


class Recorded:
    """A number whose arithmetic is recorded."""

    def __init__(self, tape: Tape, place: int):
        self.tape, self.place = tape, place

    def _with(self, operation: str, other: Any, swapped: bool = False) -> Recorded:
        a, b = self.place, self.tape.number(other).place
        return self.tape.add(operation, b, a) if swapped else self.tape.add(operation, a, b)

    def __add__(self, other: Any) -> Recorded:
        return self._with("+", other)

    def __sub__(self, other: Any) -> Recorded:
        return self._with("-", other)

    def __rsub__(self, other: Any) -> Recorded:
        return self._with("-", other, swapped=True)

    def __mul__(self, other: Any) -> Recorded:
        return self._with("*", other)

    def __truediv__(self, other: Any) -> Recorded:
        return self._with("/", other)

    def __rtruediv__(self, other: Any) -> Recorded:
        return self._with("/", other, swapped=True)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Recorded:
        return -1.0 * self

    def __pos__(self) -> Recorded:
        return self

    def __pow__(self, exponent: float) -> Recorded:
        """Whole exponents as products, which are regular at 0."""
        p = float(exponent)
        if not p.is_integer():
            return self.tape.add("**", self.place, p)
        if p < 0:
            return 1.0 / self ** (-p)
        if p < 2:
            return self if p else self.tape.number(1.0)
        half = self ** (p // 2)
        return half * half * self if p % 2 else half * half

    def sqrt(self) -> Recorded:  # what numpy.sqrt calls
        return self**0.5


# ---------------------------------------------------------------- engines: states (N, 2, n) at times (N, 2), in pairs


@cache
def engines() -> tuple[str, ...]:
    """What can take the steps here, the best first."""
    try:
        import heyoka
    except ImportError:
        return ("mpmath",)
    return ("heyoka", "mpmath") if hasattr(heyoka, "real128") else ("mpmath",)


class Singularity(Exception):
    """Steps have become too short, or are not possible; the argument is the time."""


class Heyoka:
    """Steps in IEEE 128-bit numbers, 34 digits."""

    def __init__(self, equations: Equations, tolerance: float):
        import heyoka as hy

        self.real, self.outcome = hy.real128, hy.taylor_outcome
        self.integrator = compiled(equations, tolerance)

    def states(self, start: Array, times: Array) -> Array:
        """States at `times`, which lead away from 0 in one direction, from `start` at 0."""
        ta = self.integrator
        grid = np.append(self.real(0.0), self.quadruple(times.T))
        ta.time, end = grid[0], grid[-1]
        ta.state[:] = self.quadruple(start)

        def go_on(ta: Any) -> bool:  # being called at all also lets Ctrl-C in
            return abs(float(ta.last_h)) > SHORTEST or ta.time == end

        outcome, *_, states = ta.propagate_grid(grid, callback=go_on)
        if outcome != self.outcome.time_limit:
            raise Singularity(float(ta.time))
        head = states[1:].astype(float)
        return np.stack((head, (states[1:] - self.quadruple((head,))).astype(float)), axis=1)

    def quadruple(self, parts: Sequence[Array] | Array) -> NDArray[Any]:
        """The sum of arrays of doubles."""
        return np.sum([np.asarray(part, dtype=float).astype(self.real) for part in parts], axis=0)


@lru_cache(maxsize=16)
def compiled(equations: Equations, tolerance: float) -> Any:
    """heyoka's integrator. It has a state: nothing of a run is left in it that the next does not set."""
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    variables = hy.make_vars(*(f"y{i}" for i in range(len(equations.rates))))
    e: list[Any] = []
    for operation, *rest in equations.nodes:
        if operation == "variable":
            e.append(variables[rest[0]])
        elif operation == "number":
            e.append(hy.expression(hy.real128(rest[0])))
        elif operation == "**":
            e.append(e[rest[0]] ** hy.expression(hy.real128(rest[1])))
        else:
            a, b = e[rest[0]], e[rest[1]]
            e.append(a + b if operation == "+" else a - b if operation == "-" else a * b if operation == "*" else a / b)
    system = [(v, e[place]) for v, place in zip(variables, equations.rates, strict=True)]
    zeros = [hy.real128(0.0)] * len(system)
    # unrolled code would take seconds to compile and is not faster here
    return hy.taylor_adaptive(system, zeros, tol=hy.real128(tolerance), fp_type=hy.real128, compact_mode=True)


class Mpmath:
    """Steps in mpmath, with 40 digits: the same series, step by step in the interpreter."""

    def __init__(self, equations: Equations, tolerance: float):
        self.equations, self.order = equations, math.ceil(1 - math.log(tolerance) / 2)

    def states(self, start: Array, times: Array) -> Array:
        """As `Heyoka.states`."""
        n = len(self.equations.rates)
        out = np.empty((len(times), 2, n))
        with mp.workdps(DIGITS):
            y, now = [mpf(a) + mpf(b) for a, b in start.T], mpf(0)
            wanted = [mpf(a) + mpf(b) for a, b in times]
            done, backward = 0, wanted[-1] < 0
            while done < len(wanted):
                try:
                    series = coefficients(self.equations, y, self.order)
                except ZeroDivisionError:
                    raise Singularity(float(now)) from None
                h = self.step(series)
                if not h > SHORTEST:
                    raise Singularity(float(now))
                while done < len(wanted) and abs(wanted[done] - now) <= h:
                    for i, c in enumerate(series):
                        value = _sum(c, wanted[done] - now)
                        out[done, :, i] = float(value), float(value - float(value))
                    done += 1
                h = -h if backward else h
                y, now = [_sum(c, h) for c in series], now + h
        return out

    def step(self, series: list[list[mpf]]) -> float:
        """Where the last two terms fall below the tolerance: the radius of convergence they suggest, over e²."""
        p = self.order
        size, *last = (max(abs(c[k]) for c in series) for k in (0, p - 1, p))
        size = max(size, mpf(1))
        radii = [float((size / c) ** (mpf(1) / k)) for c, k in zip(last, (p - 1, p), strict=True) if c]
        return min([*radii, 1e6]) * math.exp(-2 - 0.7 / (p - 1))


def coefficients(equations: Equations, y: Sequence[mpf], order: int) -> list[list[mpf]]:
    """Taylor coefficients of each component of y from 0 to `order`.

    ZeroDivisionError where a divisor or the base of a power vanishes.
    """
    nodes = equations.nodes
    c: list[list[mpf]] = [[] for _ in nodes]
    fixed = [node[0] == "number" for node in nodes]
    # y may have components that no rate contains, and that are not on the tape
    states = [[mpf(v)] for v in y[: len(equations.rates)]]
    for k in range(order):
        for series, (operation, *rest) in zip(c, nodes, strict=True):
            if operation == "variable":
                series.append(states[rest[0]][k])
                continue
            if operation == "number":
                series.append(mpf(0 if k else rest[0]))
                continue
            a = c[rest[0]]
            if operation == "**":
                series.append(_power(a, series, rest[1], k))
                continue
            b = c[rest[1]]
            if operation == "+":
                series.append(a[k] + b[k])
            elif operation == "-":
                series.append(a[k] - b[k])
            elif operation == "/":
                rest_of_sum = mp.fdot(b[1 : k + 1], series[k - 1 :: -1]) if k else mpf(0)
                series.append((a[k] - rest_of_sum) / b[0])
            elif fixed[rest[0]]:
                series.append(a[0] * b[k])
            elif fixed[rest[1]]:
                series.append(a[k] * b[0])
            else:
                series.append(mp.fdot(a[: k + 1], b[k::-1]))
        for state, place in zip(states, equations.rates, strict=True):
            state.append(c[place][k] / (k + 1))
    return states


def _sum(c: list[mpf], t: Any) -> mpf:
    """The series at t, by Horner's rule."""
    return reduce(lambda value, term: value * t + term, reversed(c))


def _power(a: list[mpf], b: list[mpf], p: float, k: int) -> mpf:
    """Coefficient k of b = a^p, from a b' = p a' b."""
    if k == 0:
        if a[0] == 0:
            raise ZeroDivisionError("a power of 0")
        return a[0] ** mpf(p)
    total = mp.fdot([(p * j - (k - j)) * a[j] for j in range(1, k + 1)], b[k - 1 :: -1])
    return total / (k * a[0])


# ---------------------------------------------------------------- what is kept


@cache
def _version() -> str:
    """Of the algorithm: a digest of this file."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


_memory: dict[bytes, Array] = {}
MOST_KEPT = 256  # results in memory


def _kept(key: bytes, shape: tuple[int, ...], compute: Callable[[], Array]) -> Array:
    """A table by its key, from memory, from disk or computed now; read-only.

    A file holds the table's bytes behind a digest of them and the key: one that is damaged, or lies under another's
    name, does not match and is written anew.
    """
    if key not in _memory:
        table = _stored(key, shape)
        if table is None:
            table = np.ascontiguousarray(compute(), dtype="<f8")
            _store(key, table)
        table.flags.writeable = False
        while len(_memory) >= MOST_KEPT:
            del _memory[next(iter(_memory))]
        _memory[key] = table
    return _memory[key]


def _place(key: bytes) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / "reference" / key.hex()[:32]


def _stored(key: bytes, shape: tuple[int, ...]) -> Array | None:
    place = _place(key)
    try:
        content = b"" if place is None else place.read_bytes()
    except OSError:
        return None
    seal, payload = content[:32], content[32:]
    if seal != hashlib.sha256(key + payload).digest() or len(payload) != 8 * math.prod(shape):
        return None
    return np.frombuffer(payload, dtype="<f8").reshape(shape).copy()


def _store(key: bytes, table: Array) -> None:
    place, payload = _place(key), table.tobytes()
    if place is not None:
        try:
            write_file(place, hashlib.sha256(key + payload).digest() + payload)
        except OSError:
            return  # a full or read-only disk: the result is there all the same
