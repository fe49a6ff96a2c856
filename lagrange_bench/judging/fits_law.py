"""Do the rows obey the law of the body? Momentum against torque over windows of rows.

    Δ(R I Ω) = ∫ m c × g dt + Σ a T        Δ from a row to one some rows later, vectors in the world

The left side is linear in the six numbers of I, the torque in the three of m c. So a body is a vector v of nine numbers, the rows
give a matrix X of nine columns, and X v = 0 says that they follow the body v. The null vector of X is the body that they follow.
The terms T are what a program may add or leave out, and the coefficient a is the message:

    damping     T = −∫ L dt                 a: 1/s
    torque      T = ∫ R (Ω × I_c Ω) dt      a: the share of the gyroscopic torque that is left out, I_c about the centre of mass
    explicit    T = ∫ R (Ω × I Ω)' dt       a: s, the gyroscopic torque is of so much before
    gravity     T = ∫ m c × e_i dt          a: three numbers, what is added to g
"""

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.integrators import RigidBody
from lagrange_bench.judging.findings import Finding, axis_name, numbers, say, triple
from lagrange_bench.judging.fits import EACH, Model
from lagrange_bench.judging.vectors import NEAR, ONE, PROPER, Array, common, size, tensor, to_world

# fewer rows tell no law
FEWEST = 8
# the longest window of rows
WINDOW = 32
# relative to the torques: a term below it is not seen
UNSEEN = 1e-3
# relative moments of a body: the least, and the surplus of the largest over the sum of the others
THIN, SURPLUS = 1e-4, 0.05
# a coefficient so near to one that has a name is that one, for half the cost if it is very near
ALIKE, VERY = 0.25, 0.05
# the singular vectors of X, from the smallest on, that may make a body
SMALLEST = 3
SIX = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]

# what each of the six numbers of I is in the matrix, (6, 3, 3)
BASIS = np.array([(E + E.T) / (2 if i == j else 1) for i, j in SIX for E in [np.outer(ONE[i], ONE[j])]])


class Law(NamedTuple):
    """What rows obey.

    body : v, nine numbers. other : what makes it another body than the claimed one. is_fitted : the rows gave it.
    terms : name → coefficient; of gravity all of g.
    """

    body: Array
    other: Finding | None = None
    is_fitted: bool = False
    terms: Mapping[str, float | Array] = {}


def vector(I: Array, mc: Array) -> Array:
    """The nine numbers of a body: Ixx, Iyy, Izz, Ixy, Ixz, Iyz, m c."""
    return np.array([*(I[i, j] for i, j in SIX), *mc])


def moments(v: Array) -> Array:
    """The matrix I of a body of nine numbers."""
    return np.einsum("n,nij->ij", v[:6], BASIS)


class Windows:
    """X and the terms over windows of rows.

    scale : the size of the torques over a window; misfits are relative to it. blur : the misfit that the integrals leave.
    """

    def __init__(self, t: Array, R: Array, omega: Array, body: RigidBody):
        self.t, self.R, self.body = t, R, body
        self.w = max(2, min(len(t) // 6, WINDOW))
        self.I = tensor(body)
        L = omega @ self.I
        gyro = np.cross(omega, L)
        momentum = np.einsum("kai,nij,kj->kan", R, BASIS, omega)
        # ∫ R e_j dt, with (R e_j)' = R (ω × e_j)
        self.levers = self.integral(R, R @ np.cross(omega[:, None, :], ONE).transpose(0, 2, 1))
        impulses = np.cross(self.levers, body.gravity, axisa=1, axisc=1)
        self.X = np.concatenate((self.change(momentum), -impulses), 2)
        mc = body.mass * body.com if body.fixed else np.zeros(3)
        self.claimed = vector(self.I, mc)
        span = float(np.median(t[self.w :] - t[: -self.w]))
        self.scale = max(span * size(gyro) + size(impulses @ mc), UNSEEN * size(L))
        torque = to_world(R, gyro)
        trapezia = self.integral(torque, np.zeros_like(torque))
        # trapezia lack their correction; its square is the size of what the correction leaves
        self.blur = (size(self.integral(torque) - trapezia) / self.scale) ** 2
        self.terms = {
            "damping": -self.integral(to_world(R, L)),
            "torque": self.integral(to_world(R, np.cross(omega, omega @ body.inertia_com))),
            "explicit": self.integral(to_world(R, np.gradient(gyro, t, axis=0))),
        }
        if size(self.terms["torque"]) < UNSEEN * self.scale:
            del self.terms["torque"]

    @property
    def is_heavy(self) -> bool:
        """Whether the moment m c, and so gravity, is seen."""
        return bool(np.any(self.claimed[6:]))

    def columns(self, names: tuple[str, ...], v: Array) -> list[Array]:
        """The columns T of these terms for the body v; gravity has three."""
        lever = self.levers @ v[6:]
        return [
            T
            for name in names
            for T in ([self.terms[name]] if name in self.terms else [np.cross(lever, e) for e in ONE])
        ]

    def misfit(self, v: Array | None = None) -> float:
        """By how much the rows break the law of the body v, or of the claimed one, relative to the torques."""
        return size(self.X @ (self.claimed if v is None else v)) / self.scale

    def change(self, v: Array) -> Array:
        """The change of v over each window."""
        return v[self.w :] - v[: -self.w]

    def integral(self, f: Array, slope: Array | None = None) -> Array:
        """∫ f dt over each window by trapezia with the correction h²/12 (f₀' − f₁')."""
        d = np.gradient(f, self.t, axis=0) if slope is None else slope
        dt = np.diff(self.t).reshape(-1, *[1] * (f.ndim - 1))
        steps = dt / 2 * (f[1:] + f[:-1]) + dt**2 / 12 * (d[:-1] - d[1:])
        return self.change(np.concatenate((np.zeros((1, *f.shape[1:])), np.cumsum(steps, 0))))


def laws(windows: Windows) -> Iterator[Model]:
    """Models of the law: the claimed body with up to two terms, another one with at most one; the value is a `Law`."""
    terms = [*windows.terms, "gravity"] if windows.is_heavy else windows.terms
    single = [(term,) for term in terms]
    pairs = [(*a, *b) for a, b in itertools.combinations(single, 2)]
    claimed = Law(windows.claimed)
    yield Model(0.0, windows.misfit(), claimed)
    yield from with_terms(windows, 0.0, claimed, [*single, *pairs])
    for cost, law in bodies(windows):
        yield Model(cost, windows.misfit(law.body), law)
        if not law.is_fitted:
            yield from with_terms(windows, cost, law, [names for names in single if names[0] in ("damping", "gravity")])


def with_terms(windows: Windows, cost: float, law: Law, sets: list[tuple[str, ...]]) -> Iterator[Model]:
    """Models of a body with each set of terms, if all of them are seen: X v = Σ a T by least squares."""
    defect, g, span = windows.X @ law.body, windows.body.gravity, float(np.ptp(windows.t))
    near = common(defect)
    for names in sets:
        T = np.stack(windows.columns(names, law.body), 2)
        unit = np.linalg.norm(T[near], axis=(0, 1))
        unit[unit == 0] = 1.0
        a = np.linalg.lstsq((T[near] / unit).reshape(-1, len(unit)), defect[near].ravel(), rcond=1e-6)[0] / unit
        price, is_seen = cost, True
        for place, name in enumerate(names):
            one = slice(place, None) if name == "gravity" else place
            a[one], added, is_significant = plain(name, a[one], g, span)
            price, is_seen = price + added, is_seen and is_significant
        if is_seen:
            terms = {name: g + a[n:] if name == "gravity" else a[n] for n, name in enumerate(names)}
            yield Model(price, size(defect - T @ a) / windows.scale, law._replace(terms=terms))


def plain(name: str, a: Any, g: Array, span: float) -> tuple[Any, float, bool]:
    """The coefficient of a term; its cost; whether it is seen in this span of time.

    What is added to g is cheap if gravity is then along an axis, 0, or weaker or stronger.
    """
    if name == "torque":
        cost = 0.5 if abs(a - 1) < VERY else 1.0
        return 1.0, cost, abs(a - 1) < ALIKE
    if name == "damping":
        return a, 1.0 if a > 0 else 2.0, abs(a) * span > UNSEEN
    if name == "explicit":
        return a, 1.0, True
    strength = float(np.linalg.norm(g)) or 1.0
    ratio = (g + a) / strength
    is_plain = np.abs(ratio - ratio.round()).max() < VERY and np.abs(ratio.round()).sum() < 2
    new = strength * ratio.round() - g if is_plain else a
    is_along = np.linalg.norm(np.cross(a, g)) < NEAR * strength * np.linalg.norm(a)
    return new, 1.0 if is_plain else 1.5 if is_along else 2.0, bool(np.linalg.norm(new) > NEAR * strength)


def bodies(windows: Windows) -> Iterator[tuple[float, Law]]:
    """Other bodies that a program may have followed, and their costs."""
    I, mc, body = windows.I, windows.claimed[6:], windows.body
    count = 9 if np.any(body.gravity) else 6  # without gravity m c tells nothing
    diagonal, arm, points = np.diag(np.diag(I)), I - body.inertia_com, ("fixed point", "centre of mass")
    others = [
        (1.0, say("moments left-out"), diagonal, mc),
        (1.0, say("moments sign"), 2 * diagonal - I, mc),
        (1.0, say("moments point", one=points[0], other=points[1]), I + arm, mc),
        (1.0, say("moments point", one=points[1], other=points[0]), I - arm, mc),
    ]
    for P in PROPER:
        J = P @ I @ P.T
        others.append((1.5, say("body-axes moments", axes=triple(P.T), moments=numbers(np.diag(J))), J, P @ mc))
    for cost, finding, J, lever in others:
        v = vector(J, lever)
        if np.abs(v - windows.claimed)[:count].max() > NEAR * np.abs(windows.claimed[:count]).max():
            yield cost, Law(v, finding)
    for v in followed(windows):
        I, products = moments(v), v[3:6]
        has_products = np.abs(products).max() > NEAR * np.abs(I).max()
        rest = f"products {numbers(products)}" if has_products else "no products"
        verb = "keep the momentum"
        if np.any(v[6:]):
            verb, rest = "follow the law", f"{rest}, m c = ({numbers(v[6:])}) kg m"
        yield 2.0, Law(v, say("moments", verb=verb, moments=numbers(np.diag(I)), rest=rest), is_fitted=True)


def followed(windows: Windows) -> Iterator[Array]:
    """The bodies that the rows follow: the part of the claimed body in the span of the smallest singular vectors of X."""
    count = 9 if windows.is_heavy and np.any(windows.body.gravity) else 6
    X, claimed = windows.X[:, :, :count], windows.claimed[:count]
    unit = np.repeat([np.linalg.norm(claimed[:3]), np.linalg.norm(claimed[6:])], 6)[:count]
    rows = (X[common(X @ claimed)] * unit).reshape(-1, count)
    V = np.linalg.svd(np.linalg.qr(rows, mode="r"))[2][::-1]
    misfits = [size(X @ (unit * v)) for v in V]
    for m in range(1, SMALLEST + 1):
        if misfits[m] < EACH * misfits[m - 1]:
            continue  # not all of the small ones
        v = np.zeros(9)
        v[:count] = unit * (V[:m].T @ (V[:m] @ (claimed / unit)))
        length = np.linalg.norm(v[:3])
        if length < NEAR * unit[0]:
            continue
        v *= unit[0] / length
        least, middle, most = np.linalg.eigvalsh(moments(v))
        if least > THIN * most and least + middle > (1 - SURPLUS) * most:
            yield v


def euler(t: Array, R: Array, omega: Array, body: RigidBody) -> Array:
    """I ω' + ω × I ω − m c × Rᵀg, which is 0 by Euler's equations, whether or not ω turns R."""
    L = omega @ tensor(body)
    torque = np.cross(body.mass * body.com, body.gravity @ R) if body.fixed else 0.0
    return np.asarray(np.gradient(L, t, axis=0) + np.cross(omega, L) - torque)


def of_law(law: Law, body: RigidBody) -> Iterator[Finding]:
    """What is wrong with the body, and with each term."""
    if law.other is not None:
        yield law.other
    for name, value in law.terms.items():
        if name == "gravity":
            yield of_gravity(np.asarray(value), body)
        elif name == "torque":
            yield say("gyroscopic-torque")
        elif name == "explicit":
            yield say("explicit-step", late=abs(value), side="before" if value > 0 else "after")
        elif value > 0:
            yield say("damping", rate=value)
        else:
            yield say("explicit-step grows", rate=-value)


def of_gravity(g: Array, body: RigidBody) -> Finding:
    """Another gravity, m/s²."""
    was, strength, length = body.gravity, float(np.linalg.norm(body.gravity)), float(np.linalg.norm(g))
    if length < NEAR * strength:
        return say("gravity none")
    share = float(g @ was) / strength**2 if strength else math.inf
    if np.linalg.norm(np.cross(g, was)) > NEAR * strength * length:
        up, is_as_strong = -g / length, abs(length / strength - 1) < NEAR
        if is_as_strong and np.abs(up).max() > 1 - NEAR:
            return say("world-axes gravity", axis=axis_name(up), down=axis_name(-up))
        return say("gravity", g=numbers(g), was=numbers(was))
    if abs(share + 1) < NEAR:
        return say("gravity reversed")
    return say("gravity share", length=length, share=share)
