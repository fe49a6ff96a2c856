"""Writes a case as one file of C or Python without dependencies, for tests of other programs. The templates are in `code`.

For a free body the file has the closed form of `methods.free_body`, in principal axes i, ±j, k: in this order one formula serves
all bodies. For a symmetric heavy body it has the exact step, which goes from the start to the time in a few equal steps. Their
λ = R + iη, m and χ are power series of the step h. With C1 = 1, λ = ih/2 + …, m = 1 + …,

    2η dλ/dh = −m λ̄        m² = Q(λ)        dχ/dh = −2R/|λ|²,  χ(0) = π

Whole periods are taken off the time first. Their length, and the turns in a period, have over 30 digits.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from importlib.metadata import version
from textwrap import wrap
from typing import Any

import numpy as np
from mpmath import mp, mpf
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.methods import free_body
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.free_motion import free_motion
from lagrange_bench.integrators.truth import free_body as truth
from lagrange_bench.integrators.truth import symmetric_body
from lagrange_bench.integrators.truth.exact import DIGITS
from lagrange_bench.support.precision import workdps

LANGUAGES = {"c": ("exact.c.j2", "//"), "python": ("exact.py.j2", "#")}  # template, mark of a comment
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


def parts(word: str, v: Any) -> dict[str, Any]:
    """A number of mpmath as `word`, and the part that its double lacks as `word`_lo."""
    return {word: v, f"{word}_lo": v - mpf(float(v))}


def free_constants(body: Any, y: Any) -> dict[str, Any]:
    """The numbers for the templates of a free body."""
    motion, start = free_motion(body.inertia, y[4:]), body.rotations(y)
    if motion is None:
        rate = body.angular_velocity(y)
        inertia, state = (tuple(map(Fraction, v.tolist())) for v in (body.inertia, y))
        exact: Any = truth.find_motion(inertia, state, DIGITS)
        with workdps(DIGITS):
            turn = parts("turn", exact.turn / (2 * mp.pi))
        axis = rate / (np.linalg.norm(rate) or 1.0)
        return {"kind": "spin", "rate": rate, "axis": axis, "start": start.as_quat(scalar_first=True), **turn}
    order, size = list(motion.axes), np.abs(motion.amplitudes)
    frame = np.copysign(1.0, (motion.amplitudes[0], 1.0, motion.amplitudes[2]))[:, None] * body.axes[order]
    side = np.sign(np.linalg.det(frame))  # of axis j
    frame[1] *= side
    formula = free_body.formula(motion)
    whole: dict[str, Any] = {}
    with workdps(DIGITS):
        for word in ("slow", "half", "turn"):
            whole |= parts(word, mp.fsum(getattr(formula, word)))
    s, c = formula.start
    psi = free_body.bent(formula, s, c, math.sqrt(c * c + motion.complement * s * s))
    L, to_frame = frame @ body.axes.T @ y[4:], Rotation.from_matrix(frame)
    angles = float(psi), -math.atan2(math.hypot(L[0], L[1]), L[2]), -math.atan2(L[1], L[0])
    left = start * (Rotation.from_euler("ZYZ", angles) * to_frame).inv()
    return {
        **{"kind": "free", "complement": motion.complement, "inertia": body.inertia[order], "alpha": size[0]},
        **{"beta": side * motion.amplitudes[1], "gamma": size[2], **formula._asdict(), **whole},
        **{"left": left.as_quat(scalar_first=True), "frame": to_frame.as_quat(scalar_first=True)},
    }


def heavy_constants(body: Any, y: Any) -> dict[str, Any]:
    """The numbers for the templates of a symmetric heavy body."""
    start, alpha, world = body.reduced(y), body.top.alpha, Rotation.from_matrix(body.world)
    J, x = start[:3], start[3:]
    motion, period, _ = symmetric_body.find_motion(symmetric_body.facts_of(body, y), DIGITS)
    steady, whole = motion.orbit is None, {}
    with workdps(DIGITS):
        period = mpf(1) if steady else mp.ldexp(period, -motion.rate)
        if mp.isfinite(period):
            whole = parts("period", period)
            # if the motion is steady, the turn of the top is about the other end of the axis
            side = np.sign(body.axis @ body.axes[body.symmetry]) if steady else 1
            for word, rate in ("up", motion.turn), ("spin", -2 * side * motion.spin):
                whole |= parts(word, mp.ldexp(rate, motion.rate) * period / (2 * mp.pi))
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
    own = float(body.angular_velocity(y) @ body.axis) * (1.0 - body.inertia[body.symmetry] / body.across)
    return {
        **{"kind": "steady" if steady else "heavy", "alpha": alpha, "J": J, "x0": x, "axis": body.axis, "own": own},
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
