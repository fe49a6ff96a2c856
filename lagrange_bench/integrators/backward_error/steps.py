"""The step of each method as a power series in h, at many states at once.

If a kernel is a formula, the kernel itself runs on power series. If it iterates, or rounds a function to a polynomial, its
equations are solved in power series. `STEPS` has no entry for a step without a series.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from types import CellType, FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.compiling.loops import SIZE
from lagrange_bench.integrators.methods import bobenko_suris as bs
from lagrange_bench.integrators.methods import gauss_coefficients as gauss
from lagrange_bench.integrators.methods import kahan, lie_group, runge_kutta
from lagrange_bench.integrators.methods.splitting_schemes import SCHEMES
from lagrange_bench.integrators.methods.tableaux import DOP853, DORMAND_PRINCE, RK4, VERNER9, Tableau
from lagrange_bench.integrators.problem.system import uniform_system
from lagrange_bench.integrators.problem.vectors import cross


class Series:
    """A truncated power series Σ c[k] h^k, exact up to round-off; `c` is (terms, points), of any type.

    A comparison is true if it is true for the leading coefficients at every point.
    """

    __array_ufunc__ = None  # so NumPy uses the operators below

    def __init__(self, c: NDArray[Any]):
        self.c = c

    def __add__(self, other: Any) -> Series:
        c = self.c.copy()
        c[: len(c) if isinstance(other, Series) else 1] += other.c if isinstance(other, Series) else other
        return Series(c)

    def __neg__(self) -> Series:
        return Series(-self.c)

    def __sub__(self, other: Any) -> Series:
        return self + -other

    def __rsub__(self, other: Any) -> Series:
        return -self + other

    def __mul__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Series(self.c * other)
        c = np.zeros_like(self.c)
        for k in np.flatnonzero(self.c.any(axis=1)):
            c[k:] += self.c[k] * other.c[: len(c) - k]
        return Series(c)

    def __truediv__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Series(self.c / other)
        c = np.empty_like(self.c)
        for k in range(len(c)):
            c[k] = (self.c[k] - np.sum(c[:k] * other.c[k:0:-1], axis=0)) / other.c[0]
        return Series(c)

    def __rtruediv__(self, other: Any) -> Series:
        return (self * 0.0 + other) / self

    def sqrt(self) -> Series:
        """The root with a positive leading coefficient."""
        c = np.empty_like(self.c)
        c[0] = np.sqrt(self.c[0])
        for k in range(1, len(c)):
            c[k] = (self.c[k] - np.sum(c[1:k] * c[k - 1 : 0 : -1], axis=0)) / (2.0 * c[0])
        return Series(c)

    def __gt__(self, other: float) -> bool:
        return bool(np.all(self.c[0] > other))

    def __le__(self, other: float) -> bool:
        return bool(np.all(self.c[0] <= other))

    __radd__, __rmul__ = __add__, __mul__


State = tuple[Any, ...]  # J1, J2, J3, x1, x2, x3
Step = Callable[[float, State, Series, int], State]  # (alpha, state, h, highest power of h) → the state after a step

COUNTERS = np.zeros(SIZE)  # for kernels, which report nothing here


class Functions:
    """The functions of `math` that kernels call, for series."""

    sqrt = Series.sqrt


def on_series(thing: Any) -> Any:
    """A kernel, and all that it calls, as Python functions that take series; other things unchanged."""
    if isinstance(thing, tuple):
        return tuple(map(on_series, thing))
    function = getattr(thing, "py_func", thing)  # of a kernel or an unrolled function; without compilation it is one
    if isinstance(function, FunctionType):
        return _on_series(function)
    return Functions if thing is math else thing


@cache
def _on_series(function: FunctionType) -> FunctionType:
    known, code = function.__globals__, function.__code__
    names = {name: on_series(known[name]) for name in code.co_names if name in known}
    closure = tuple(CellType(on_series(cell.cell_contents)) for cell in function.__closure__ or ())
    return FunctionType(code, names, function.__name__, function.__defaults__, closure)


def rhs(alpha: float, s: State) -> State:
    return -alpha * s[4], alpha * s[3], 0.0 * s[2], *cross(s[:3], s[3:])


def taylor_flow(alpha: float, s: State, h: Series, power: int) -> State:
    """The Taylor series of the exact motion, by Picard's iteration, one term after the other."""
    c = [part.c.copy() for part in s]
    for k in range(power):
        rates = rhs(alpha, tuple(Series(part[: k + 1]) for part in c))
        for part, rate in zip(c, rates, strict=True):
            part[k + 1] = rate.c[k] / (k + 1)
    return tuple(map(Series, c))


def runge_kutta_step(tableau: Tableau, alpha: float, s: State, h: Series, power: int) -> State:
    d = runge_kutta.increment_of(tableau, uniform_system())(0.0, *s, h, alpha)
    return s[0] + d[0], s[1] + d[1], s[2], s[3] + d[2], s[4] + d[3], s[5] + d[4]


def projected_step(tableau: Tableau, alpha: float, s: State, h: Series, power: int) -> State:
    """A Runge–Kutta step, then one Newton step to the nearest point with the invariants of s.

    A second Newton step would change only terms of second order.
    """
    project, in_units = map(on_series, runge_kutta.projection(uniform_system()))
    units = (1.0, 1.0, 1.0, 1.0)
    invariants = in_units(s, (0.0, 0.0, 0.0, *units, alpha))[3]
    after = runge_kutta_step(tableau, alpha, s, h, power)
    return project(after, (*invariants, *units, alpha), COUNTERS)


def taylor_step(order: int, alpha: float, s: State, h: Series, power: int) -> State:
    after = taylor_flow(alpha, s, h, order)
    for part in after:
        part.c[order + 1 :] = 0.0
    return after


def collocation_step(stages: int, alpha: float, s: State, h: Series, power: int) -> State:
    """K = h b f(y + μ K), by iteration. Each iteration gives one more power of h."""
    _, b, mu = gauss.tableau(stages)
    weights, mu_ = [h * float(w) for w in b], [[float(m) for m in row] for row in mu]
    K: list[State] = [tuple(0.0 * part for part in s)] * stages
    for _ in range(power):
        Y = [tuple(y + sum(m * k[i] for m, k in zip(row, K, strict=True)) for i, y in enumerate(s)) for row in mu_]
        K = [tuple(w * rate for rate in rhs(alpha, u)) for w, u in zip(weights, Y, strict=True)]
    return tuple(y + sum(k[i] for k in K) for i, y in enumerate(s))


def splitting_step(name: str, alpha: float, s: State, h: Series, power: int) -> State:
    scheme = SCHEMES[name]
    force = alpha * (h * h)
    none = (0.0,) * len(scheme.b)
    kicks = list(zip(scheme.b, scheme.c or none, scheme.d or none, strict=True))
    if scheme.first == "B":
        s = kicked(kicks.pop(0), alpha, s, h, force)
    for k, a in enumerate(scheme.a):
        s = *s[:3], *turned(a * h, s[:3], s[3:], power)
        if k < len(kicks):
            s = kicked(kicks[k], alpha, s, h, force)
    return s


def kicked(coefficients: tuple[float, float, float], alpha: float, s: State, h: Series, force: Series) -> State:
    b, c, d = coefficients
    x1, x2, x3 = s[3:]
    kick = b + (2.0 * c) * force * x3 - (2.0 * d) * (force * force) * (x1 * x1 + x2 * x2 - 2.0 * (x3 * x3))
    kick = (alpha * h) * kick
    return s[0] - kick * x2, s[1] + kick * x1, *s[2:]


def turned(t: Series, J: State, x: State, power: int) -> State:
    """x turned about J by the angle t|J|: the series of exp(t J×) x."""
    axis, term = [t * v for v in J], x
    for k in range(1, power + 1):
        term = tuple(v / k for v in cross(axis, term))
        x = tuple(a + b for a, b in zip(x, term, strict=True))
    return x


def kernel_step(
    kernel: Any, constants: Callable[[float, Series], Any], alpha: float, s: State, h: Series, _: int
) -> State:
    return on_series(kernel)(s, constants(alpha, h), COUNTERS)


def half_step(alpha: float, h: Series) -> Any:
    return 0.5 * h, 0.5 * alpha * h


def generator_step(alpha: float, h: Series) -> Any:
    return 0.0, h, alpha


# one entry for each method
FORMULAS = {"rk4": RK4, "rk45_fixed": DORMAND_PRINCE, "dop853_fixed": DOP853, "verner9_fixed": VERNER9}
STEPS: dict[str, Step] = {
    "taylor_fixed": partial(taylor_step, 20),
    **{name: partial(runge_kutta_step, tableau) for name, tableau in FORMULAS.items()},
    "verner9_projected": partial(projected_step, VERNER9),
    **{name: partial(splitting_step, name) for name in SCHEMES},
    "kahan": partial(kernel_step, kahan.step, half_step),
    "bobenko_suris": partial(kernel_step, bs.kernel(uniform_system()), lambda alpha, h: (h, 0.0, alpha)),
    "implicit_midpoint": partial(collocation_step, 1),
    **{f"gauss{2 * stages}": partial(collocation_step, stages) for stages in (2, 3, 4)},
    "rkmk4": partial(kernel_step, lie_group.kernel(uniform_system()), generator_step),
}
