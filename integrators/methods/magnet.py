"""Kernels that loop over arrays of spins, for Gaudin magnets with any number of them: what records have as `special["spins"]`.

The flow of Σ c_j H_j turns each spin about the gradient of

    Σ_j b_j s_j³ + Σ_{j<k} K_jk s_j·s_k,    b_j = 2 alpha c_j,    K_jk = 2 (c_j − c_k)/(a_j − a_k).

- Splitting by pairs: b_j alone is a turn of s_j about e3, and K_jk alone a turn of s_j and s_k about s_j + s_k. A sweep
  φ takes all of them one after another, its adjoint φ* in the opposite order; schemes are φ*, φ, φ*, … with weights.
- Implicit midpoint: it keeps the H_j and s_j², which are quadratic. Spherical midpoint: the field at the
  midpoint put back on its sphere; it is symplectic and keeps s_j² and the total s³.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.checks import Array, check_grid, check_step
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE
from lagrange_bench.integrators.interface import Method, StepError, Stepper, Work
from lagrange_bench.integrators.methods.dense import Run, dense
from lagrange_bench.integrators.methods.dop853 import check_tolerances
from lagrange_bench.integrators.methods.lie_group import add, cross, dot, times

ITERATIONS = 200  # of an implicit step, at most


def prepare_exact(problem: Any, y0: Array, h: float) -> Any:
    """The exact step: half as many two-point maps as spins, and a turn about e3, see `paper.gaudin_step`."""
    from lagrange_bench.integrators.paper import gaudin_step  # with mpmath: a top does not wait for it

    return gaudin_step.prepare_exact(problem.magnet, y0, h)


def prepare_paper(problem: Any, y0: Array, h: float, *, factors: int = 1) -> Any:
    """The two-point maps of order 2·factors, see `paper.gaudin_step`."""
    from lagrange_bench.integrators.paper import gaudin_step

    return gaudin_step.prepare(problem.magnet, y0, h, factors=factors)


def terms(magnet: Any) -> tuple[Array, NDArray[np.int64], Array]:
    """b (n,), pairs (m, 2) with K ≠ 0 and K (m,)."""
    c = magnet.flow
    K = magnet.bonds(c)
    pairs = np.ascontiguousarray(np.argwhere(np.triu(K) != 0))  # else one or many pairs are two types to Numba
    return 2.0 * magnet.alpha * c, pairs, K[pairs[:, 0], pairs[:, 1]]


class _CompiledStepper(Stepper):
    """Advances real spins by a compiled loop: run(s, b, pairs, K, h, *constants, first, last, every, out) → failed step."""

    def __init__(self, name: str, run: Callable, magnet: Any, h: float, *constants: Any):
        self.name, self.run, self.magnet, self.h, self.work = name, run, magnet, check_step(h), Work()
        self.constants = (*terms(magnet), self.h, *constants)

    def record(self, y: Array, n: int, every: int) -> Array:
        """Spins after 0, every, 2·every, … n steps, each in the shape of `y`, (sites, 3) or (3 sites,)."""
        check_grid(n, every)
        s = np.array(self.magnet.check_spins(y), dtype=float)
        out = np.empty((n // every + 1, *s.shape))
        out[0] = s
        b, _, K, *_ = self.constants
        some = max(1, INTERRUPTIBLE // (len(b) + len(K)))  # Ctrl-C is seen between two calls
        for first in range(0, n, some):
            last = min(first + some, n)
            failed, iterations = self.run(s, *self.constants, first, last, every, out)
            self.work.iterations += iterations
            self.work.rhs_evals += iterations
            if failed >= 0:
                raise StepError(self.name, f"no solution after {ITERATIONS} iterations", h=self.h, step=failed)
        if not np.all(np.isfinite(s)):
            raise StepError(self.name, "the spins left the range of floating-point numbers", h=self.h, step=n)
        self.work.steps += n
        return out.reshape(len(out), *np.shape(y))


# ------------------------------------------------------------------------------------------ splitting by pairs


@jit
def sweep(s, b, pairs, K, t, forward):
    """All parts of the Hamiltonian over the time t, the field first or last."""
    m = len(K)
    for i in range(m + 1):
        p = i - 1 if forward else m - 1 - i
        if p < 0:
            for j in range(len(b)):
                cos, sin = math.cos(t * b[j]), math.sin(t * b[j])
                x, y = s[j, 0], s[j, 1]
                square = x * x + y * y
                u, v = cos * x - sin * y, sin * x + cos * y
                if square > 0.0:  # the turn is the same at every step, and so is cos² + sin² − 1
                    e = 0.5 * ((u * u - square) + v * v) / square
                    u, v = u - e * u, v - e * v
                s[j, 0], s[j, 1] = u, v
            continue
        j, k = pairs[p, 0], pairs[p, 1]
        v, w = (s[j, 0], s[j, 1], s[j, 2]), (s[j, 0] + s[k, 0], s[j, 1] + s[k, 1], s[j, 2] + s[k, 2])
        size = math.sqrt(dot(w, w))
        if size == 0.0:
            continue
        half = 0.5 * t * K[p] * size
        sin = math.sin(half)
        u = cross(w, v)
        d = add(times(2.0 * sin * math.cos(half) / size, u), 2.0 * sin * sin / (size * size), cross(w, u))
        for i in range(3):
            s[j, i] += d[i]
            s[k, i] -= d[i]


@jit
def assign(to, values):
    """to[:] = values, of rows of three numbers; Numba compiles that for two seconds."""
    for j in range(len(values)):
        for i in range(3):
            to[j, i] = values[j, i]


@jit
def run_splitting(s, b, pairs, K, h, weights, first, last, every, out):
    """Steps of φ*, φ, φ*, φ, … with weights (an even number)."""
    for step in range(first, last):
        for i in range(len(weights)):
            sweep(s, b, pairs, K, h * weights[i], i % 2 == 1)
        if (step + 1) % every == 0:
            assign(out[(step + 1) // every], s)
    return -1, 0


def alternating(a: tuple[float, ...], b: tuple[float, ...]) -> list[float]:
    """a1, b1, a2, b2, …"""
    return [x for pair in itertools.zip_longest(a, b) for x in pair if x is not None]


def weights_of_two(a: tuple[float, ...], b: tuple[float, ...]) -> Array:
    """The weights of φ*, φ, φ*, … that for a sum of two parts is the splitting a1, b1, a2, b2, … (McLachlan)."""
    return np.array(list(itertools.accumulate(alternating(a, b)[:-1], lambda weight, letter: letter - weight)))


def _blanes_moan4() -> tuple[tuple[float, ...], tuple[float, ...]]:
    a1, a2, a3 = 0.0792036964311957, 0.353172906049774, -0.0420650803577195
    b1, b2 = 0.209515106613362, -0.143851773179818
    a = (a1, a2, a3, 1 - 2 * (a1 + a2 + a3), a3, a2, a1)
    b = (b1, b2, 0.5 - (b1 + b2), 0.5 - (b1 + b2), b2, b1)
    return a, b


# ------------------------------------------------------------------------------------------ midpoint rules


@jit
def run_midpoint(s, b, pairs, K, h, spherical, first, last, every, out):
    """s' = s + h grad × m at m = (s + s')/2; spherical: at |s| m/|m|. By fixed-point iteration until it stalls."""
    n = len(b)
    middle, field, mean, size = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    iterations = 0
    for step in range(first, last):
        for j in range(n):
            size[j] = math.sqrt(s[j, 0] ** 2 + s[j, 1] ** 2 + s[j, 2] ** 2)
        assign(mean, s)
        old = np.inf
        for _ in range(ITERATIONS):
            iterations += 1
            for j in range(n):
                factor = 1.0
                if spherical and size[j] > 0.0:
                    factor = size[j] / math.sqrt(mean[j, 0] ** 2 + mean[j, 1] ** 2 + mean[j, 2] ** 2)
                for i in range(3):
                    middle[j, i] = factor * mean[j, i]
                    field[j, i] = 0.0
                field[j, 2] = b[j]
            for p in range(len(K)):
                j, k = pairs[p, 0], pairs[p, 1]
                for i in range(3):
                    field[j, i] += K[p] * middle[k, i]
                    field[k, i] += K[p] * middle[j, i]
            change = 0.0
            for j in range(n):
                for i in range(3):
                    u, v = (i + 1) % 3, (i + 2) % 3
                    new = s[j, i] + 0.5 * h * (field[j, u] * middle[j, v] - field[j, v] * middle[j, u])
                    change += abs(new - mean[j, i])
                    mean[j, i] = new
            if not change < np.inf:
                return step, iterations
            if change == 0.0 or (change <= 1e-15 * np.sum(size) and change >= 0.5 * old):
                break
            old = change
        else:
            return step, iterations
        for j in range(n):
            for i in range(3):
                s[j, i] += 2.0 * (mean[j, i] - s[j, i])
        if (step + 1) % every == 0:
            assign(out[(step + 1) // every], s)
    return -1, iterations


def unit(spins: Array) -> float:
    """A power of two, 1 or less, in which the largest spin is not small: tolerances of libraries are absolute below 1."""
    return math.ldexp(1.0, min(0, math.frexp(float(np.max(np.abs(spins))))[1]))


def dop853_runner(problem: Any, *, rtol: float = 3e-14) -> Run:
    """SciPy's DOP853 with its dense output; the absolute tolerance is a tenth of the relative one, times the largest spin."""
    from scipy.integrate import solve_ivp

    rtol, _ = check_tolerances(rtol, 0.0)
    magnet, c = problem.magnet, problem.magnet.flow

    def run(y: Array, grid: Array, work: Work) -> Array:
        size = unit(y)

        def rhs(_: float, y: Array) -> Array:
            return magnet.rhs(size * y.reshape(-1, 3), c).ravel() / size / size

        found = solve_ivp(rhs, (0, grid[-1] * size), y / size, "DOP853", grid * size, rtol=rtol, atol=rtol / 10)
        if not found.success:
            raise StepError("scipy_dop853", found.message)
        work.rhs_evals += found.nfev
        return found.y.T * size

    return run


def of_loop(name: str, run: Callable, *constants: Any) -> Callable[..., Stepper]:
    """The builder of a compiled loop with these constants."""
    return lambda problem, y0, h: _CompiledStepper(name, run, problem.magnet, h, *constants)


# builders by the names of the methods that have them: general kernels unroll all pairs of spins, these loop over any number
SPINS = {
    "strang": of_loop("strang", run_splitting, weights_of_two((0.5, 0.5), (1.0,))),
    "blanes_moan4": of_loop("blanes_moan4", run_splitting, weights_of_two(*_blanes_moan4())),
    "implicit_midpoint": of_loop("implicit_midpoint", run_midpoint, False),
    "scipy_dop853": dense("scipy_dop853", dop853_runner)[0],
}

SPHERICAL_MIDPOINT = Method(
    name="spherical_midpoint", label="Spherical midpoint", family="implicit", order=2, symmetric=True, poisson=True,
    conserves=frozenset({"J3", "C1", "C2"}), source="McLachlan, Modin and Verdier, Phys. Rev. E 89 (2014) 061301",
    prepare=of_loop("spherical_midpoint", run_midpoint, True), needs="spins",
)  # fmt: skip
