"""Writes a case as one file of C or Python without dependencies, for tests of other programs. The templates are in `code`.

For a free body the file has a closed form in principal axes i, ±j, k; in this order one formula serves all bodies. With the
constants and axes of `problem.free_motion` and L upright, axis k has turned about the vertical since u = 0 by

    ψ = a_j G t + (a_j G² − D)/(G λ) C(u) + atan(p sn u cn u/dn u)        p = (a_i − a_j) G/λ
    C(u) = ∫ N sn²/(1 − N sn²) du = N sn³/3 · R_J(cn², dn², 1, 1 − N sn²)     1 − N = (a_j G² − D)/(a_i G² − D)

(Landau & Lifshitz, Mechanics, section 37, with their −r taken to N = (k² + r)/(1 + r) by DLMF 19.7.10: then all terms have one
sign, or, for bodies of matter, cancel by half at most.) Then R(t) = R(0) M(0)ᵀ M(t), M = R3(ψ) R2(−θ) R3(−η), with
η = arg(L_1 + i L_2) and the angle θ from axis k to L, in axes 1, 2, 3 = k.

For a symmetric heavy body it has the exact step, which goes from the start to the time in a few equal steps. Their
λ = R + iη, m and χ are power series of the step h. With C1 = 1, λ = ih/2 + …, m = 1 + …,

    2η dλ/dh = −m λ̄        m² = Q(λ)        dχ/dh = −2R/|λ|²,  χ(0) = π

Whole periods are taken off the time first. Their length, and the turns in a period, have over 30 digits.
"""

import math
from functools import cache
from importlib.metadata import version
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from flint import arb, fmpq
from mpmath import mp, mpf
from scipy.spatial.transform import Rotation
from scipy.special import elliprf, elliprj

from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.free_motion import FreeMotion, free_motion
from lagrange_bench.integrators.truth.curve import BITS
from lagrange_bench.integrators.truth.exact import as_mpf, motion_of
from lagrange_bench.integrators.truth.table import exact_period, turns_in
from lagrange_bench.support.precision import workdps, workprec

LANGUAGES = {"c": ("exact.c.j2", "//"), "python": ("exact.py.j2", "#")}  # template, mark of a comment
DIGITS = 40  # of periods and turns
TERMS = 10  # of each power series
LEFT_OUT = 2.0**-55  # size of the first term that is left out, at the longest step


def standalone(case: Case, language: str, facts: list[str]) -> str:
    """The text of the file. facts : lines about the body, for the head of the file.

    Raises
    ------
    ValueError
        The motion has no closed form.
    """
    body = case.body
    y, _ = body.split_state(case.state)
    if kinds.free_body(body):
        constants = free_constants(body, y)
    elif kinds.symmetric_body(body):
        constants = heavy_constants(body, y)
    else:
        raise ValueError(
            f"{case.name}: a heavy body that is not symmetric has no closed form; leave out --code for its rows"
        )
    check, (template, mark) = case.solution([case.until]), LANGUAGES[language]
    constants.update(
        language=language, name=case.name, facts=[line for v in facts for line in wrap(v.replace("\\", "/"), 118)],
        version=version("lagrange-bench"), turning=constants["kind"] in ("heavy", "steady"), fixed=body.fixed, com=body.com,
        gravity=body.gravity, place=case.state[7:10], velocity=case.state[10:], until=case.until,
        q=check.rotation.as_quat(canonical=True, scalar_first=True)[0], omega=check.omega_body[0], x=check.position[0],
    )  # fmt: skip
    head = templates().get_template("head.j2").render(constants).splitlines()
    constants["head"] = "\n".join(f"{mark} {line}".rstrip() for line in head)
    return templates().get_template(template).render(constants)


@cache
def templates() -> Any:
    """The files in `code`."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("lagrange_bench.integrators.cases", "code"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    filters = environment.filters
    filters["number"] = lambda v: repr(float(v) + 0.0)  # the shortest decimal that gives the same double
    filters["numbers"] = lambda values: ", ".join(map(filters["number"], values))
    filters["decimal"] = lambda v: mp.nstr(v, DIGITS - 5)
    return environment


def parts(word: str, v: arb) -> dict[str, Any]:
    """A number as `word`, and the part that its double lacks as `word`_lo."""
    exact = as_mpf(v.mid())
    with workdps(DIGITS):
        return {word: +exact, f"{word}_lo": exact - mpf(float(exact))}


def free_constants(body: Any, y: Any) -> dict[str, Any]:
    """The numbers for the templates of a free body."""
    numbers, start = free_motion(body.inertia, y[4:]), body.rotations(y)
    exact: Any = motion_of(body, y)
    if numbers is None:
        rate = body.angular_velocity(y)
        with workprec(BITS):
            turn = sum((drift.left for drift in exact.drifts()), arb(0)) / (2 * arb.pi())
        axis = rate / (np.linalg.norm(rate) or 1.0)
        return {
            "kind": "spin",
            "rate": rate,
            "axis": axis,
            "start": start.as_quat(scalar_first=True),
            **parts("turn", turn),
        }
    order, size = list(numbers.axes), np.abs(numbers.amplitudes)
    frame = np.copysign(1.0, (numbers.amplitudes[0], 1.0, numbers.amplitudes[2]))[:, None] * body.axes[order]
    side = np.sign(np.linalg.det(frame))  # of axis j
    frame[1] *= side
    with workprec(BITS):
        slow = exact.a[order[1]] * arb(exact.G2).sqrt() / (2 * arb.pi())
        whole = parts("slow", slow)
        if exact.node is None:
            period = exact_period(exact)
            turn = exact.half_turn(period, order[2]) - slow * period / 2
            whole |= {**parts("half", arb(period / 2)), **parts("turn", turn - turn.mid().floor())}
    form = formula(numbers)
    s, c = form.start
    psi = bent(form, s, c, math.sqrt(c * c + numbers.complement * s * s))
    L, to_frame = frame @ body.axes.T @ y[4:], Rotation.from_matrix(frame)
    angles = float(psi), -math.atan2(math.hypot(L[0], L[1]), L[2]), -math.atan2(L[1], L[0])
    left = start * (Rotation.from_euler("ZYZ", angles) * to_frame).inv()
    return {
        **{"kind": "free", "complement": numbers.complement, "inertia": body.inertia[order], "alpha": size[0]},
        **{"beta": side * numbers.amplitudes[1], "gamma": size[2], **form._asdict(), **whole},
        **{"left": left.as_quat(scalar_first=True), "frame": to_frame.as_quat(scalar_first=True)},
    }


class Formula(NamedTuple):
    """The numbers of the formula for a free body, in its doubles."""

    start: tuple[float, float]  # sn and cn of u0, on the unit circle
    phase: float  # u0; u = λ t + u0
    rate: float  # λ
    fast: float  # (a_j G² − D)/(G λ)
    bend: float  # p
    ratio: float  # N
    rest: float  # 1 − N


def formula(motion: FreeMotion) -> Formula:
    """The numbers of a motion, computed from fractions and rounded once."""
    (s, c), (a_i, a_j, _), G, rate = motion.start, motion.inverse, motion.momentum, motion.rate
    size = math.hypot(s, c)
    s, c = s / size, c / size
    return Formula(
        start=(s, c),
        phase=s * float(elliprf(c * c, c * c + motion.complement * s * s, 1.0)),
        rate=float(rate),
        fast=float(motion.middle / (G * rate)),
        bend=float((a_i - a_j) * G / rate),
        ratio=float((a_i - a_j) * G**2 / motion.high),
        rest=float(motion.middle / motion.high),
    )


def bent(f: Formula, s: float, c: float, d: float) -> float:
    """ψ − a_j G t, from sn, cn and dn."""
    if f.rest == 0.0:  # on the separatrix cn = dn
        return math.atan(f.bend * s)
    C = f.ratio * s**3 / 3.0 * elliprj(c * c, d * d, 1.0, c * c + f.rest * s * s)
    return float(f.fast * C + math.atan2(f.bend * s * c, d))


def heavy_constants(body: Any, y: Any) -> dict[str, Any]:
    """The numbers for the templates of a symmetric heavy body."""
    start, alpha, world = body.reduced(y), body.top.alpha, Rotation.from_matrix(body.world)
    J, x = start[:3], start[3:]
    exact: Any = motion_of(body, y)
    whole: dict[str, Any] = {}
    if exact.node is None:
        with workprec(BITS):
            if exact.steady:
                period, drifts = fmpq(1), exact.drifts()
                up, spin = (sum(rates, arb(0)) for rates in ([v.left for v in drifts], [v.right for v in drifts]))
                up, spin = up / (2 * arb.pi()), spin / (2 * arb.pi())
            else:
                period = exact_period(exact)
                up, spin = map(arb, turns_in(exact, period))
                spin += exact.spin * period / (2 * arb.pi())
            side = int(np.sign(body.axis @ body.axes[body.symmetry]))
            whole = {**parts("period", arb(period)), **parts("up", up), **parts("spin", side * spin)}
    unit = 1.0 / (float(np.linalg.norm(J)) + math.sqrt(alpha))
    # Q(λ) = 1 + 2 C2 λ + 2 H λ² + 2 alpha J3 λ³ + alpha² λ⁴
    Q = (
        2.0 * (J @ x) * unit,
        (J @ J + 2.0 * alpha * x[2]) * unit**2,
        2.0 * alpha * J[2] * unit**3,
        (alpha * unit**2) ** 2,
    )
    rows = series(Q)
    last = np.max(np.abs(rows[TERMS:]), axis=1)  # the first two terms left out: some series lack every other term
    reach = 1.0 / np.max((last / LEFT_OUT) ** (0.5 / np.array((TERMS, TERMS + 1))))  # longest step, in units
    scales = np.array((unit * reach**2, unit * reach, 1.0, reach, reach)) * reach ** (2.0 * np.arange(TERMS)[:, None])
    relative_spin = float(body.angular_velocity(y) @ body.axis) * (1.0 - body.inertia[body.symmetry] / body.across)
    return {
        **{
            "kind": "steady" if exact.steady else "heavy",
            "alpha": alpha,
            "J": J,
            "x0": x,
            "axis": body.axis,
            "own": relative_spin,
        },
        **{"left": world.inv().as_quat(scalar_first=True), "longest": unit * reach, "rows": rows[:TERMS] * scales},
        **{"right": (world * body.rotations(y)).as_quat(scalar_first=True), **whole},
    }


def series(Q: tuple[float, ...]) -> Any:
    """Coefficients (TERMS + 2, 5) of R/h², η/h, Re m, Im m/h, (χ − π)/h in powers of h²; Q(λ) = 1 + Q1 λ + … + Q4 λ⁴."""
    size = 2 * TERMS + 5
    lam, m = np.zeros(size, complex), np.zeros(size, complex)
    lam[1], m[0] = 0.5j, 1.0
    for n in range(1, size):
        if n > 1:  # the terms of order n in the equation for λ, with λ_n on the left
            j = np.arange(2, n)
            rest = -m[1:n] @ lam[n - 1 : 0 : -1].conj() - np.sum(2.0 * lam[j].imag * (n + 1 - j) * lam[n + 1 - j])
            lam[n] = complex(rest.real / (n + 1), rest.imag / n)
        square, power = 0j, lam
        for factor in Q:
            square += factor * power[n]
            power = np.convolve(power, lam)[:size]
        m[n] = (square - m[1:n] @ m[n - 1 : 0 : -1]) / 2.0
    norm = np.convolve(lam, lam.conj()).real[2:size]  # |λ|²/h²
    slope = np.zeros(size - 2)  # dχ/dh
    for n in range(size - 2):
        slope[n] = (-2.0 * lam[n + 2].real - norm[1 : n + 1] @ slope[:n][::-1]) / norm[0]
    k = np.arange(TERMS + 2)
    columns = lam[2 * k + 2].real, lam[2 * k + 1].imag, m[2 * k].real, m[2 * k + 1].imag, slope[2 * k] / (2 * k + 1)
    return np.stack(columns, axis=1)
