"""Takes a Hamiltonian apart into parts whose flows are closed formulas, for splittings.

    kick      a function of t and x on e3: x stays, J grows by τ ∂U/∂x × x
    axis      a function of t and of components along one axis: these stay, each vector turns about the axis
    square    a multiple of |J|² on e3: J stays, x turns about it; on so3 a Casimir function, nothing moves
    pair      a multiple of s_j·s_k: both spins turn about their sum
    free      of a whole body, a multiple of |L|² and a function of L along one axis: the free symmetric top

For a whole body a kick is a function of t and q, and q turns with the body. A flow leaves t as it is: the splitting advances it.

H is read from its tape as a sum. Products are multiplied out if a factor does not depend on y. An addend that is none of these
parts has no closed flow here. If two of the coefficients of J1², J2², J3² are equal, |J|² is taken out of them.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lagrange_bench.integrators.compiling.expression import Program, cos, sin, sqrt
from lagrange_bench.integrators.compiling.tape import Tape, Term
from lagrange_bench.integrators.problem.system import BODY, E3, Space, System, depends
from lagrange_bench.integrators.problem.vectors import cross, cross_in, dot

TINY = 1e-300  # added to the square of a length: a vector of length 0 gives no 0/0
Key = tuple[Any, ...]  # of a part: its kind, then the axis of "axis" and "free", the vectors of "square" and "pair"


@dataclass(frozen=True)
class Part:
    """A part H_i of H: a program of (t, y, p), its kind, and the space on which its flow acts. body : see `System`."""

    key: Key
    energy: Program
    space: Space
    body: bool

    @property
    def kind(self) -> str:
        """One of "kick", "axis", "square", "pair", "free"."""
        return str(self.key[0])

    @cached_property
    def digest(self) -> str:
        """Identity of the part."""
        return f"{'-'.join(map(str, self.key))} {self.energy.digest} {self.space.name} {self.body}"

    @cached_property
    def timed(self) -> bool:
        """Whether it depends on t."""
        return depends(self.energy, [0])

    @cached_property
    def parameters(self) -> int:
        """The number of parameters of H."""
        return self.energy.inputs - 1 - self.space.size

    @cached_property
    def flow(self) -> Program:
        """(t, y, τ, p) → y after the time τ."""
        tape = Tape()
        t, y, span = tape.input(), tuple(tape.input() for _ in range(self.space.size)), tape.input()
        p = [tape.input() for _ in range(self.parameters)]
        slopes = tape.gradient(tape.run(self.energy, t, *y, *p)[0], y)
        if self.space == BODY:
            return tape.program(self._whole(tape, y, slopes, span))
        turn = {"kick": self._kick, "axis": self._axis, "square": self._square, "pair": self._pair}[self.kind]
        return tape.program(turn(y, slopes, -span if self.body else span))

    def _whole(self, tape: Tape, y: Sequence[Any], g: Sequence[Any], span: Any) -> list[Any]:
        """q and L of a whole body after the time `span`; g is ∂H/∂y.

        kick : L grows by span times the torque of ∂H/∂q. square, free : q turns about L by span · rate |L|, where
        ∂H/∂L = rate L + rest. axis, free : q and L turn about axis k by span · rest_k.
        """
        if self.kind == "kick":
            push = self.space.flow((*g[:4], *(tape.constant(0.0),) * 3), y, cross_in(self.body))[4:]
            return [*y[:4], *(v + span * w for v, w in zip(y[4:], push, strict=True))]
        q, L = list(y[:4]), list(y[4:])
        if self.kind in ("square", "free"):
            other = 4 if self.kind == "square" else 4 + (self.key[1] + 1) % 3
            rate = tape.gradient(g[other], y)[other]
            q = turned_about(q, [rate * v for v in L], span, self.body)
            g = [slope - rate * v for slope, v in zip(g[4:], L, strict=True)]
        else:
            g = g[4:]
        if self.kind in ("axis", "free"):
            k, half = self.key[1], 0.5 * (span * g[self.key[1]])
            i, j, c, s = (k + 1) % 3, (k + 2) % 3, cos(half), sin(half)
            sign = -1.0 if self.body else 1.0
            L[i], L[j] = of_length(rotated(L[i], L[j], 1.0 - 2.0 * s * s, sign * (2.0 * s * c)), (L[i], L[j]))
            q[0], q[1 + k] = rotated(q[0], q[1 + k], c, s)
            q[1 + i], q[1 + j] = rotated(q[1 + i], q[1 + j], c, sign * s)
        return [*of_length(q, y[:4]), *L]

    # the other flows: y after the time `span`; g is ∂H/∂y

    def _kick(self, y: Sequence[Any], g: Sequence[Any], span: Any) -> list[Any]:
        # J' = ∂H/∂x × x, x' = 0
        torque = cross(g[3:], y[3:])
        return [*(v + span * w for v, w in zip(y[:3], torque, strict=True)), *y[3:]]

    def _axis(self, y: Sequence[Any], g: Sequence[Any], span: Any) -> list[Any]:
        # x → R x, J → R (J + span ∂H/∂x × x); R turns by span ∂H/∂J about the axis. Each spin has its own R
        axis, new = self.key[1], list(y)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        if self.space.affine:
            new[i], new[j] = new[i] - span * g[3 + axis] * y[3 + j], new[j] + span * g[3 + axis] * y[3 + i]
        for first in range(0, len(y), 3):
            angle = span * g[axis if self.space.affine else first + axis]
            new[first + i], new[first + j] = turned(new[first + i], new[first + j], angle)
        return new

    def _square(self, y: Sequence[Any], g: Sequence[Any], span: Any) -> list[Any]:
        """x' = 2w J × x, J' = 0, with ∂H/∂J = 2w J and so 2w = ∂H/∂J·J/|J|²."""
        J, x = y[:3], y[3:]
        change = rotation_change(J, x, span * (dot(g[:3], J) / (dot(J, J) + TINY)))
        return [*J, *(v + d for v, d in zip(x, change, strict=True))]

    def _pair(self, y: Sequence[Any], g: Sequence[Any], span: Any) -> list[Any]:
        """s_j' = K (s_j + s_k) × s_j, and the same for s_k; ∂H/∂s_j = K s_k and so K = ∂H/∂s_j·s_k/|s_k|²."""
        new, (j, k) = list(y), self.key[1:]
        s, r = y[3 * j : 3 * j + 3], y[3 * k : 3 * k + 3]
        strength = dot(g[3 * j : 3 * j + 3], r) / (dot(r, r) + TINY)
        change = rotation_change([a + b for a, b in zip(s, r, strict=True)], s, span * strength)
        for i, d in enumerate(change):
            new[3 * j + i], new[3 * k + i] = s[i] + d, r[i] - d
        return new


def turned(u: Any, v: Any, angle: Any) -> tuple[Any, Any]:
    """(u, v) turned by an angle, with its length corrected."""
    if isinstance(angle, Term) and angle.tape.known(angle) == 0.0:
        return u, v
    a, b = of_length(rotated(u, v, cos(angle), sin(angle)), (u, v))
    return a, b


def rotated(u: Any, v: Any, c: Any, s: Any) -> tuple[Any, Any]:
    """(u, v) turned by the angle with cosine c and sine s."""
    return c * u - s * v, s * u + c * v


def of_length(new: Sequence[Any], old: Sequence[Any]) -> list[Any]:
    """new (1 − (|new|² − |old|²)/(2|old|²)), as long as `old`; otherwise the round-off of sin² + cos² − 1 may add up."""
    square = sum((v * v for v in old[1:]), old[0] * old[0])
    share = 0.5 / (square + TINY)  # a division takes long, so it divides by what is known first
    lack = share * sum((v * v for v in new[1:]), new[0] * new[0] - square)
    return [v - lack * v for v in new]


def rotation_change(axis: Sequence[Any], v: Sequence[Any], rate: Any) -> list[Any]:
    """sin φ/|a| a × v + 2 sin²(φ/2)/|a|² a × (a × v), the change of v by a turn about a = `axis` by φ = rate |a|."""
    square = dot(axis, axis)
    size = sqrt(square)
    half = 0.5 * rate * size
    s = sin(half)
    first, second = 2.0 * s * cos(half) / (size + TINY), 2.0 * s * s / (square + TINY)
    u = cross(axis, v)
    return [first * a + second * b for a, b in zip(u, cross(axis, u), strict=True)]


def turned_about(q: Sequence[Any], omega: Sequence[Any], span: Any, body: bool) -> list[Any]:
    """q p, or p q if ω is in the world's frame, p = (cos θ, sin θ ω/|ω|), θ = span |ω|/2: q turned by ω, see `of_length`."""
    speed = sqrt(dot(omega, omega))
    half = 0.5 * span * speed
    c, s = cos(half), sin(half) * (1.0 / (speed + TINY))
    across = cross(q[1:], omega) if body else cross(omega, q[1:])
    across_q = (-dot(omega, q[1:]), *(q[0] * w + v for w, v in zip(omega, across, strict=True)))
    return [c * a + s * b for a, b in zip(q, across_q, strict=True)]


# ------------------------------------------------------------------------------------ taking H apart


def find_parts(system: System, numbers: tuple[float, ...]) -> list[Part]:
    """The parts of H with the parameters `numbers`; [] if an addend has no closed flow."""
    tape, space, energy = Tape(), system.space, system.energy
    inputs = [tape.input() for _ in range(energy.inputs)]
    y = inputs[1 : 1 + space.size]
    first = space.momenta.start
    vectors = y[first:]
    (H,) = tape.run(energy, *inputs)
    terms: dict[Key, list[Term]] = defaultdict(list)
    products: dict[Key, dict[int, Term]] = defaultdict(dict)  # both vectors of a product → axis → weight
    for weight, core in addends(tape, tape.constant(1.0), H, y):
        moved = [i for i, v in enumerate(y) if depends_on(tape, core, {v.place})]
        pair = _product(tape, core, vectors)
        if not moved:
            continue
        if (space.affine and min(moved) >= 3) or max(moved) < first:
            terms["kick",].append(weight * core)
            continue
        moved = [i - first for i in moved]
        if min(moved) < 0:
            return []
        if pair and moved[0] % 3 not in products[pair] and not (space.affine and pair == (1, 1)):
            products[pair][moved[0] % 3] = weight
        elif len({i % 3 for i in moved}) == 1:
            terms["axis", moved[0] % 3].append(weight * core)
        else:
            return []
    for (j, k), weights in products.items():
        values = {axis: _value(tape, weight, numbers) for axis, weight in weights.items()}
        same = [axis for axis in values if list(values.values()).count(values[axis]) > 1]
        common = weights[same[0]] if len(values) == 3 and same else None
        round_body = common is not None and space == BODY
        if common is not None and j == k and (space.affine or round_body):
            terms["square", j].append(common * dot(vectors[:3], vectors[:3]))
        elif common is not None and j != k and not space.affine:
            terms["pair", j, k].append(common * dot(y[3 * j : 3 * j + 3], y[3 * k : 3 * k + 3]))
        for axis, weight in weights.items():
            if common is None or axis not in same:
                rest = weight if common is None else weight - common
                terms["axis", axis].append(rest * (vectors[3 * j + axis] * vectors[3 * k + axis]))
    axes = [key for key in terms if key[0] == "axis"]
    if space == BODY and ("square", 0) in terms and len(axes) == 1:  # they commute
        terms["free", axes[0][1]] = terms.pop(("square", 0)) + terms.pop(axes[0])
    order = ("square", "pair", "free", "axis", "kick")
    keys = sorted(terms, key=lambda key: (order.index(key[0]), key[1:]))
    return [Part(key, tape.program((sum(terms[key], tape.constant(0.0)),)), space, system.body) for key in keys]


def _value(tape: Tape, weight: Term, numbers: tuple[float, ...]) -> Any:
    """A weight as a number, or as its formula if it depends on t."""
    program = tape.program((weight,))
    return weight.place if depends(program, [0]) else program(*(0.0,) * (program.inputs - len(numbers)), *numbers)


def addends(tape: Tape, weight: Term, term: Term, y: Sequence[Term]) -> Iterator[tuple[Term, Term]]:
    """Pairs (weight, core) with weight × term = Σ weight core. Weights do not depend on y, and cores are no sums."""
    operation, *arguments = tape.lines[term.place]
    places = {v.place for v in y}
    if operation in ("add", "sub", "neg"):
        for i, place in enumerate(arguments):
            minus = operation == "neg" or (operation == "sub" and i == 1)
            yield from addends(tape, -weight if minus else weight, Term(tape, place), y)
        return
    if operation in ("mul", "div"):
        a, b = (Term(tape, place) for place in arguments)
        if not depends_on(tape, b, places):
            yield from addends(tape, weight * b if operation == "mul" else weight / b, a, y)
            return
        if operation == "mul" and not depends_on(tape, a, places):
            yield from addends(tape, weight * a, b, y)
            return
    yield weight, term


def depends_on(tape: Tape, term: Term, places: set[int]) -> bool:
    return not places.isdisjoint(tape.needed([term]))


def _product(tape: Tape, core: Term, y: Sequence[Term]) -> tuple[int, int] | None:
    """The numbers of both vectors, if `core` is a product of two components along one axis; otherwise None."""
    operation, *arguments = tape.lines[core.place]
    component = {v.place: i for i, v in enumerate(y)}
    if operation != "mul" or not all(place in component for place in arguments):
        return None
    i, k = sorted(component[place] for place in arguments)
    return (i // 3, k // 3) if i % 3 == k % 3 else None


# ------------------------------------------------------------------------------------ |J|²/2 + U(t, x)


def is_top(parts: tuple[Part, ...], numbers: tuple[float, ...]) -> bool:
    """Whether these parts of H are |J|²/2 and a function of t and x, in the frame of the world."""
    squares = [part for part in parts if part.kind == "square"]
    if len(squares) != 1 or any(part.kind not in ("square", "kick") for part in parts):
        return False
    (square,) = squares
    plain = square.space == E3 and not (square.body or square.timed)
    return plain and bool(square.energy(0.0, 1.0, *(0.0,) * 5, *numbers)[0] == 0.5)


def weight_and_rest(parts: Sequence[Part], count: int) -> tuple[Program, Program]:
    """alpha and V of U = alpha x3 + V, as programs of t, y and `count` parameters; alpha depends on the parameters alone."""
    tape = Tape()
    inputs = [tape.input() for _ in range(7 + count)]
    t, x3, one = inputs[0], inputs[6], tape.constant(1.0)
    alpha = rest = tape.constant(0.0)
    for kick in (part for part in parts if part.kind == "kick"):
        for weight, core in addends(tape, one, tape.run(kick.energy, *inputs)[0], inputs[1:7]):
            if core.place != x3.place:
                rest = rest + weight * core
                continue
            for factor, change in addends(tape, one, weight, [t]):
                if depends_on(tape, change, {t.place}):
                    rest = rest + factor * change * x3
                else:
                    alpha = alpha + factor * change
    return tape.program((alpha,)), tape.program((rest,))
