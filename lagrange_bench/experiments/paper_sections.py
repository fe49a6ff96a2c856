"""Runs the paper, section by section, for `lagrange-bench paper`: by how much does each formula miss?

Each function `check_…` takes a top and a real state, and returns residuals, name → (residual, allowed). Most residuals are
relative to 1 plus the size of their terms. Nothing is stored, because a section runs in seconds.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.interface import INVARIANTS, Array
from lagrange_bench.integrators.paper import (
    contraction,
    discrete_lax,
    euler_angles,
    eulerian,
    generating_functions,
    interpolating_flow,
    lax,
    one_point,
    separation,
    two_point,
)
from lagrange_bench.integrators.paper.phase_space import invariants, vector_field
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.truth import exact

Residuals = dict[str, tuple[float, float]]


def size(a: Any) -> float:
    return float(np.max(np.abs(np.asarray(a)), initial=0.0))


def miss(a: Any, b: Any, *terms: Any) -> float:
    """The largest of max|a − b|/(1 + max|a| + max|b| + Σ max|terms|), the maxima of each row."""
    arrays = [np.asarray(v, dtype=complex) for v in (a, b, *terms)]
    largest = [np.abs(v).reshape(len(v), -1).max(axis=1) for v in (arrays[0] - arrays[1], *arrays)]
    return float(np.max(largest[0] / (1 + sum(largest[1:]))))


def parameter(top: LagrangeTop, y: Array, share: float = 0.4) -> complex:
    """A λ well above the real axis, nearer to 0 than any root of Q."""
    roots = np.roots([complex(c) for c in lax.spectral_polynomial(top, y)][::-1])
    return share * min(abs(roots)) * complex(math.cos(1.2), math.sin(1.2))


def orbit(top: LagrangeTop, y: Array, nutations: float, points: int) -> tuple[Array, Array]:
    """Times and states of the exact motion over `nutations` periods; without a period over ten time scales each."""
    period = exact.nutation_period(top, y)
    t = np.linspace(0.0, nutations * (period if math.isfinite(period) else 10 * top.scales(y)[2]), points)
    return t, exact.solution(top, y, t)


def order_miss(x: Any, error: Any, order: int) -> float:
    """The distance between `order` and the slope of log error against log x, by least squares."""
    return float(abs(np.polyfit(np.log(x), np.log(error), 1)[0] - order))


def check_contraction(top: LagrangeTop, y: Array) -> Residuals:
    """2: two spins of the magnet become the top; what is contracted, against ε."""
    lam, eps = parameter(top, y), 2.0 ** -np.arange(6, 15)
    results = [contraction.deviations(top, y, lam, float(e)) for e in eps]
    errors = {name: np.array([row[name] for row in results]) for name in results[0]}
    residuals = {f"{name}: order in ε, less 1": (order_miss(eps, error, 1), 0.05) for name, error in errors.items()}
    magnet, spins = contraction.to_magnet(top, y, 0.125)
    residuals["H from the magnet at ε = 1/8"] = (abs(contraction.energy(magnet, spins) - invariants(top, y)[0]), 1e-11)
    return residuals


def check_separation(top: LagrangeTop, y: Array) -> Residuals:
    """3: the separation variables and the Darboux chart along an orbit."""
    states = orbit(top, y, 3.0, 601)[1].astype(complex)
    H, J3, c1, c2 = (v[0] for v in invariants(top, states))
    w, z = separation.separate(states), separation.to_darboux(states)
    d = 1e-5 * top.scales(y)[2]
    ahead, behind = (separation.separate(states + s * d * vector_field(top, states)) for s in (1, -1))
    rates = separation.separated_rates(top, w, c1, c2)
    p, u = separation.generated(z[:, :2], w[:, 1::2], c1, c2)
    v = w[:, 1] - 1j * top.alpha
    lam = parameter(top, y)
    pairs = [(state, lax.eigenvalue(top, state, lam)) for state in states]
    psi = np.array([separation.baker_akhiezer(top, state, lam, mu) for state, mu in pairs])
    image = np.array([lax.lax_matrix(top, state, lam) @ one for (state, _), one in zip(pairs, psi, strict=True)])
    rows = np.array([separation.adjugate_row(top, *each) for each in zip(states, w[:, 0], v, strict=True)])
    terms = np.concatenate((w, 1 / w), axis=1) ** 2
    residuals: Residuals = {
        "(3.1) the row at (u1, v1 − iα)": (miss(rows, 0 * rows, terms), 1e-13),
        "(3.2) L ψ = μ ψ": (miss(image, np.array([mu for _, mu in pairs])[:, None] * psi, psi**2), 1e-13),
        "(3.8) and back": (miss(separation.unseparate(w, c1, c2), states, terms), 1e-13),
        "(3.9) H": (miss(separation.separated_hamiltonian(top, w, c1, c2), H + 0 * v, terms), 1e-13),
        "(3.10) J3": (miss(separation.separated_J3(w), J3 + 0 * v), 1e-13),
        "(u1, v1 − iα) on the curve": (miss(v * v, lax.spectral_curve(top, states, w[:, 0]), terms), 1e-13),
        "motion of u, v": (miss((ahead - behind) / (2 * d), rates, terms), 1e-8),
        "(3.11) and back": (miss(separation.from_darboux(z, c1, c2), states, z**2), 1e-13),
        "(3.14) p": (miss(p, z[:, 2:], terms), 1e-13),
        "(3.14) u": (miss(u, w[:, ::2]), 1e-13),
    }
    return residuals


def check_euler(top: LagrangeTop, y: Array) -> Residuals:
    """4: Euler angles, and the motion by ℘, ζ and σ."""
    t, states = orbit(top, y, 2.0, 33)
    by_sigma, angles = euler_angles.states(top, y, t), euler_angles.angles(top, y, t)
    _, _, c1, c2 = (float(v) for v in invariants(top, y))
    H = float(invariants(top, y)[0])
    rates = euler_angles.rates(top.alpha, angles, c1, c2)
    d = 1e-5 * top.scales(y)[2]
    ahead, behind = (euler_angles.angles(top, y, t[1::8] + s * d) for s in (1, -1))
    residuals: Residuals = {
        "℘, ζ, σ against theta functions": (miss(by_sigma, states), 1e-13),
        "(4.1) and (4.5)": (miss(euler_angles.from_angles(angles, c1, c2), states), 1e-12),
        "(4.3) H": (miss(euler_angles.hamiltonian(top.alpha, angles, c1, c2), np.full(len(t), H)), 1e-12),
        "(4.2) θ', φ', p'": (miss((ahead - behind) / (2 * d), rates[1::8]), 1e-8),
    }
    return residuals


def check_one_point(top: LagrangeTop, y: Array) -> Residuals:
    """5.1: the one-point map on its complex orbit."""
    lam, steps = parameter(top, y), 60
    states, _ = one_point.orbit(top, y + 0j, lam, steps)
    values = np.array(invariants(top, states)).T
    error = np.abs(values - values[0]) / (1 + np.sum(np.abs(states) ** 2, axis=1))[:, None]
    image = one_point.one_point(top, states, lam)
    _, q = one_point.parameters(top, states, lam)
    terms = np.concatenate((q[:, None] ** 2 * states**2, q[:, None] * states**3, states**2), axis=1)
    other = 0.5 * lam + 0.1
    twice = [one_point.one_point(top, one_point.one_point(top, states, a), b) for a, b in ((lam, other), (other, lam))]
    u = 0.7 + 0.3j
    p, new_q = (states[:, 0] - 1j * states[:, 1]) / (2 * top.alpha), (image[:, 0] + 1j * image[:, 1]) / (2 * top.alpha)
    M = np.array([one_point.dressing_matrix(*pair, lam, u) for pair in zip(p, new_q, strict=True)])
    L, L_new = (np.array([lax.lax_matrix(top, state, u) for state in each]) for each in (states, image))
    k, x3, xm = one_point.k_value(top, states, lam), states[:, 5], states[:, 3] - 1j * states[:, 4]
    residuals: Residuals = {
        "(5.1.3) M L = L̃ M": (miss(M @ L, L_new @ M, terms), 1e-12),
        "(5.1.6) q": (miss(q, new_q, terms), 1e-12),
        "(5.2.6) k": (miss(k, x3 - q * xm, terms), 1e-12),
        **{f"{name} along {steps} steps": (size(error[:, i]), 1e-12) for i, name in enumerate(INVARIANTS)},
        "(5.1.11) against (5.1.10)": (miss(one_point.real_form(top, states, lam), image, terms), 1e-12),
        "the inverse": (miss(one_point.inverse(top, image, lam), states, image**2), 1e-11),
        "two λ commute": (miss(*twice, image**2), 1e-11),
    }
    return residuals


def check_generating(top: LagrangeTop, y: Array) -> Residuals:
    """5.2 to 5.4: generating functions, spectrality, and the same in Euler angles."""
    share = np.linspace(0.2, 1.0, 25)
    start, rows = y + 0j, []
    _, _, c1, c2 = (complex(v) for v in invariants(top, start))
    for lam in map(complex, parameter(top, y) * share):
        image, d = one_point.one_point(top, start, lam), 1e-6 * abs(lam)
        old, new, k = generating_functions.arguments(top, start, image)
        middle = generating_functions.eigenvalue(top, lam, c1, c2, old, new, k)
        ahead, behind = (generating_functions.generating_function(top, lam + s, c1, c2, old, new, k) for s in (d, -d))
        momenta = np.array(generating_functions.momenta(top, lam, c1, c2, old, new, k))
        momenta -= (start[2], start[5], image[2], image[5])
        angles = np.array(eulerian.momenta(top, lam, c1, c2, *eulerian.arguments(top, start, image)))
        angles -= np.concatenate([euler_angles.to_angles(state)[2:] for state in (start, image)])
        pair = generating_functions.states(top, lam, c1, c2, old, new, k)
        related = size(np.array(pair) - (start, image)) / (1 + size(image) ** 3)
        errors = size(momenta) / (1 + size(image)), size(angles) / (1 + size(image) ** 2), related
        rows.append((lax.eigenvalue(top, start, lam), middle, (behind - ahead) / (2 * d), *errors))
    mu, middle, slopes, momenta, angles, related = np.array(rows).T
    residuals: Residuals = {
        "(5.2.3), (5.2.4) the states": (size(related), 1e-11),
        "(5.2.6) J3, x3 and their images": (size(momenta), 1e-11),
        "(5.3.2) μ": (size((middle - mu) / mu), 1e-11),
        "(5.3.1) −∂F/∂λ, by differences": (size((slopes - mu) / mu), 1e-6),
        "(5.4) momenta of the Euler angles": (size(angles), 1e-10),
    }
    return residuals


def check_two_point(top: LagrangeTop, y: Array) -> Residuals:
    """5.5, 5.6: the two-point map with independent λ1, λ2, and the flows it discretises."""
    lam1, lam2 = parameter(top, y), parameter(top, y, 0.25).conjugate() + 0.05
    start = y + 0j
    first, second = two_point.point(top, start, lam1, -1), two_point.point(top, start, lam2, -1)
    image = two_point.explicit(top, start, first, second)
    m = tuple(1j * lam * lam * mu for lam, mu in (first, second))
    scale = 1 + size(image) ** 2
    forms = {
        "(5.5.10)": two_point.real_generators(top, start, first, second),
        "the program's": two_point.matrix_form(top, start, first, second),
        "pole-free": two_point.pole_free(top, start, lam1, lam2, m=m),
    }
    residuals: Residuals = {f"(5.5.9) against {name}": (size(f - image) / scale, 1e-11) for name, f in forms.items()}
    u = 0.7 + 0.3j
    x, X = two_point.parameters(top, start, first, second)
    M = two_point.dressing_matrix(x, X, lam1, lam2, u)
    L, L_new = (lax.lax_matrix(top, state, u) for state in (start, image))
    residuals["(5.5.2) M L = L̃ M"] = (miss([M @ L], [L_new @ M], [M**2]), 1e-11)
    middle = one_point.one_point(top, start, lam1, mu=first[1])
    composed = one_point.inverse(top, middle, lam2, mu=second[1])
    determinant = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    residuals["(5.5.4) det M"] = (miss([determinant], [(u - lam1) * (u - lam2)], [M**2]), 1e-11)
    residuals["(5.5.1) one-point maps"] = (miss([composed], [image], [middle**2]), 1e-11)
    forms_of_x = two_point.expressions_x(top, start, image, first, second)
    forms_of_X = two_point.expressions_X(top, start, image, first, second)
    differences = [*(form - x for form in forms_of_x), *(form - X for form in forms_of_X)]
    residuals["(5.5.5), (5.5.6) x and X"] = (size(differences) / scale, 1e-11)
    residuals["the inverse"] = (size(two_point.inverse(top, image, first, second) - start) / scale, 1e-11)
    changes = np.array(invariants(top, image)) - np.array(invariants(top, start))
    residuals["H, J3, C1, C2"] = (size(changes) / scale, 1e-11)
    T, turn = (complex(v) for v in interpolating_flow.time_and_turn(top, y, lam1, lam2))
    ours = two_point.pole_free(top, start, lam1, lam2)
    by_flow = interpolating_flow.interpolated(top, start, T, turn)
    residuals["complex time and turn of the step"] = (miss([by_flow], [ours]), 1e-10)
    # λ1 → λ2: (image − y)/ε, ε = iΔλ, against the flow of iμ2
    eps = 2.0 ** -np.arange(4, 15)
    rate = interpolating_flow.limit_rate(top, start, lam2)
    slopes = [(two_point.pole_free(top, start, lam2 - 1j * e, lam2) - start) / e for e in eps]
    error = [size(slope - rate) / (1 + size(rate)) for slope in slopes]
    residuals["the flow of iμ2: order in ε, less 1"] = (order_miss(eps[3:], error[3:], 1), 0.05)
    real = two_point.pole_free(top, start, lam1, lam1.conjugate())
    residuals["imaginary part at λ2 = λ̄1"] = (size(real.imag) / scale, 1e-12)
    return residuals


def check_flow(top: LagrangeTop, y: Array) -> Residuals:
    """5.6: the interpolating flow, T and Θ of a step."""
    lam = parameter(top, y, 0.9)
    shares = np.linspace(0.1, 1.0, 10)
    clock = np.array([[float(v) for v in interpolating_flow.time_and_turn(top, y, complex(s * lam))] for s in shares])
    errors = []
    for share, (T, turn) in zip(shares, clock, strict=True):
        image = two_point.real_form(top, y, complex(share * lam))
        errors.append(size(interpolating_flow.interpolated(top, y, T, turn) - image))
    steps, iterated = np.arange(200), [y]
    T, turn = clock[-1]
    for _ in steps[1:]:
        iterated.append(two_point.real_form(top, iterated[-1], complex(lam)))
    turned = one_point.gauge(exact.solution(top, y, T * steps), np.exp(-1j * turn * steps)).real
    d = 1e-4  # H_int along λ = s λ1, λ̄ = s λ̄1
    ahead, behind = (interpolating_flow.hamiltonian(top, y, s * lam, s * lam.conjugate()) for s in (1 + d, 1 - d))
    rate, right = (ahead - behind) / (2 * d), -2 * (lam * lax.eigenvalue(top, y + 0j, lam, -1)).real
    residuals: Residuals = {
        "the step is the flow over T, turned by Θ": (size(errors), 1e-11),
        "the same after 200 steps": (size(np.array(iterated) - turned), 1e-10),
        "∂H_int/∂λ is −μ": (float(abs(rate - right) / (1 + abs(rate))), 1e-6),
    }
    return residuals


def check_discrete(top: LagrangeTop, y: Array) -> Residuals:
    """5: the discrete tops of Bobenko–Suris and Kahan, their Lax pair and their clock."""
    unit = top.scales(y)[2]
    h = 0.5 * unit
    image = prepare(top, y, h, "bobenko_suris").advance(y, 1)
    u = 0.7 + 0.3j
    M, L, new = discrete_lax.dressing(y, h, u), *(discrete_lax.lax_matrix(top, s, h, u) for s in (y, image))
    elsewhere, step = discrete_lax.of_kahan(top, y, h)
    lam, m = discrete_lax.curve_point(y, h)
    origin, target = (discrete_lax.deformed(top, state, h) for state in (y, image))
    moved = two_point.pole_free(top, origin + 0j, lam, lam.conjugate(), m=(m, m.conjugate()))
    kahan = discrete_lax.of_kahan(top, prepare(top, y, h, "kahan").advance(y, 1), h)[0]
    same = prepare(top, elsewhere, step, "bobenko_suris").advance(elsewhere, 1)
    residuals: Residuals = {
        "M L − L̃ M of Bobenko and Suris": (size(M @ L - new @ M) / (1 + size(L)), 1e-12),
        "the two-point map of the deformed state": (size(moved - target) / (1 + size(target)), 1e-12),
        "Kahan's step as one of theirs": (size(same - kahan) / (1 + size(kahan)), 1e-12),
    }
    hs = unit * 2.0 ** -np.arange(1.0, 7.0)
    rates: dict[str, list[float]] = {"bobenko_suris": [], "kahan": [], "backlund_paper": []}
    for k in map(float, hs):
        z = {"bobenko_suris": (y, k), "kahan": discrete_lax.of_kahan(top, y, k)}
        for name, (state, length) in z.items():
            T = discrete_lax.clock(top, state, length)[0]
            period = exact.nutation_period(top, discrete_lax.deformed(top, state, length))
            rates[name].append(abs(T / period * exact.nutation_period(top, y) / k - 1))
        T = float(interpolating_flow.time_and_turn(top, y, 0.5j * k * math.hypot(*y[3:]))[0])
        rates["backlund_paper"].append(abs(T / k - 1))
    for name, errors in rates.items():
        residuals[f"clock of {name}: order, less 2"] = (order_miss(hs[2:], errors[2:], 2), 0.1)
    return residuals


SECTIONS: dict[str, tuple[str, Callable[[LagrangeTop, Array], Residuals]]] = {
    "contraction": ("2", check_contraction),
    "separation": ("3", check_separation),
    "euler": ("4", check_euler),
    "discrete": ("5", check_discrete),
    "one-point": ("5.1", check_one_point),
    "generating": ("5.2–5.4", check_generating),
    "two-point": ("5.5, 5.6", check_two_point),
    "flow": ("5.6", check_flow),
}


def title(name: str) -> str:
    """The title of a section, in one line."""
    text = SECTIONS[name][1].__doc__ or ""
    return text.strip().partition(": ")[2].rstrip(".")
