"""Why do rows leave the motion of a rigid body? A few least-squares fits of physical laws, and one rule that chooses (`fits`).

    clock        |Θ'| = unit · |ω|,  x = x₀ + v t + g t²/2     unit of time, a constant that is added to the times
    frames       R_exact = W R B,  x_exact = M W x + m         axes, hand, order of quaternions, unit of length, origin
    kinematics   M ω = Θ'                                      frame, unit, sign, axes and time of ω
    law          Δ(R I Ω) = ∫ m c × g dt + Σ a T               moments, gravity, damping, gyroscopic torque, explicit step

Each fit looks at the rows as the findings before it mend them, so that two mistakes are both named. A wrong finding is worse than
none: a law that holds to 3e-3 needs no cause, rows that are far apart are asked for their frames only, and digits hide misfits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators import RigidBody
from lagrange_bench.judging import findings
from lagrange_bench.judging import fits_frames as ff
from lagrange_bench.judging import fits_kinematics as fk
from lagrange_bench.judging import fits_law as fl
from lagrange_bench.judging.findings import Finding, Words
from lagrange_bench.judging.fits import CLEARLY, EACH, GOOD, NEAR, ONE, Array, Choice, Model, choose, maps, rotvec, size

# at most so many rows are looked at, and so many findings told
MOST, TOLD = 2000, 3
# fewer rows tell nothing, and fewer with five others around them no rates
FEWEST, RATES = 8, 12
# rad between rows, beyond which turns may be others than they seem
COARSE = 1.0
# a law that holds to this share needs no cause
WORTH = 3e-3
# ω that turn the body to this share are right
TURNS = 0.02
# and if they are off by more than that and none of the causes is clear, nothing can be said of the law
UNCLEAR = 0.2
# relative, or rad: a start that is off by less is no other start; so many first rows tell it from noise
ANOTHER_START, STARTING = 0.05, 9
# misfits below it are round-off
ROUND_OFF = 1e-9
# unit of time → s, and how near to it the ratio of two speeds must be
CLOCKS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
ALIKE = {"ms": 0.4, "us": 0.4, "ns": 0.4, "min": 0.03}


class Rows(NamedTuple):
    """What a file says: times (N,), s; matrices (N, 3, 3), ω (N, 3) in `frame`, positions (N, 3), angles (N, 3) in rad, or None.

    Rotations take the body to the world. angles : the columns from which the rotations come, if they are angles.
    """

    t: Array
    R: Array | None = None
    omega: Array | None = None
    x: Array | None = None
    frame: str = fk.BODY
    angles: Array | None = None


class Floor(NamedTuple):
    """The errors that the digits of a file hide: s, rad, rad/s, m."""

    t: float = 0.0
    R: float = 0.0
    omega: float = 0.0
    x: float = 0.0


def diagnose(
    rows: Rows,
    ways: Mapping[str, Array],
    body: RigidBody,
    exact: ff.Exact | None = None,
    floor: Floor = Floor(),  # noqa: B008
) -> list[Finding]:
    """What is wrong with rows, in at most three findings, the first cause first; [] if nothing is clear.

    Parameters
    ----------
    rows : Rows
        In the axes of the case. At most 2000 first rows are looked at; rows with a NaN are left out.
    ways : dict of (N, 3, 3)
        Other ways to read the rotations: the option → matrices. That they may be transposed need not be said.
    body : RigidBody
        The body that moves.
    exact : function, optional
        Times (n,) → positions, matrices, and ω in the body of the exact motion, if the start is known; NaN where they are not.
    floor : Floor
        The errors that the digits of the file hide.
    """
    with np.errstate(all="ignore"):
        return Diagnosis(rows, ways, body, exact, floor).made()


class Diagnosis:
    """Rows as the findings so far mend them.

    W, B : what takes their rotations to those of the case, W R B. is_clear : ω turns the body, or it is known why not.
    """

    def __init__(self, rows: Rows, ways: Mapping[str, Array], body: RigidBody, exact: ff.Exact | None, floor: Floor):
        good = np.isfinite(rows.t)
        for part in (rows.R, rows.omega, rows.x):
            if part is not None:
                good &= np.isfinite(part).reshape(len(good), -1).all(1)
        keep = np.flatnonzero(good)[:MOST]
        R, omega, x, angles = (
            part if part is None else part[keep] for part in (rows.R, rows.omega, rows.x, rows.angles)
        )
        self.rows = Rows(rows.t[keep], R, omega, x, rows.frame, angles)
        self.ways = {name: R[keep] for name, R in ways.items()}
        self.body, self.exact, self.floor = body, exact, floor
        self.W, self.B, self.is_clear, self.found = ONE, ONE, True, list[Finding]()

    def made(self) -> list[Finding]:
        """The findings, by one fit after the other."""
        if len(self.rows.t) >= FEWEST:
            self.time_unit()
            if self.exact is not None:
                self.times_and_frames(self.exact)
            self.motion()
            if self.rows.x is not None:
                self.positions(self.rows.x)
            if self.exact is not None and not self.found:
                self.start(self.exact)
        return self.found[:TOLD]

    def tell(self, words: Words | Iterable[Words], before: float, after: float) -> None:
        """Add findings, unless their cause is told already."""
        for each in [words] if isinstance(words, Words) else words:
            if all(each.cause != finding.cause for finding in self.found):
                self.found.append(Finding(each.cause, f"{each.text}.", float(before), float(after), each.option))

    @property
    def step(self) -> float:
        """The time between two rows."""
        return float(np.median(np.diff(self.rows.t)))

    # ---------------------------------------------------------------- by the clock and the exact motion

    def time_unit(self) -> None:
        """How fast the rows turn or fly, over how fast they should: a unit of time?"""
        ratio = self.speed_ratio()
        for unit, factor in CLOCKS.items():
            # degrees that were taken for radians turn some 57 times too fast, which is no minute
            alike = ALIKE[unit] if self.rows.angles is None else 0.1 * ALIKE[unit]
            if abs(ratio / factor - 1) < alike:
                text = f"the times are in {findings.CLOCK_NAMES[unit]}: --units t={unit}"
                self.tell(Words("time-unit", text, f"--units t={unit}"), abs(ratio - 1), abs(ratio / factor - 1))
                self.rows = self.rows._replace(t=self.rows.t * factor)
                self.floor = self.floor._replace(t=self.floor.t * factor)
                return

    def speed_ratio(self) -> float:
        """How fast the rows turn or move by their own times, over how fast by the exact motion, by ω, or by gravity."""
        rows, start = self.rows, slice(0, 4)
        dt = np.diff(rows.t[start])[:, None]
        if self.exact is not None:
            moment = 1e-6 * min(1.0, float(dt[0, 0]))
            x, _, omega = self.exact(np.array([0.0, moment]))
            if rows.R is not None:
                turns = rotvec(rows.R[:3].transpose(0, 2, 1) @ rows.R[1:4])
                return size(turns / dt) / (float(np.linalg.norm(omega[0])) or math.nan)
            if rows.x is not None:
                return (
                    size(np.diff(rows.x[start], axis=0) / dt)
                    * moment
                    / (float(np.linalg.norm(x[1] - x[0])) or math.nan)
                )
            return math.nan
        if rows.R is not None and rows.omega is not None:
            return size(fk.rates(rows.t, rows.R)[0]) / (size(rows.omega) or math.nan)
        if rows.x is not None and not self.body.fixed:
            g, off = ff.parabola(rows.t, rows.x)
            strength = float(np.linalg.norm(self.body.gravity)) or math.nan
            return math.sqrt(float(np.linalg.norm(g)) / strength) if off < WORTH else math.nan
        return math.nan

    def times_and_frames(self, exact: ff.Exact) -> None:
        """A constant of the times, and the reading and the axes of the rotations."""
        rows, first = self.rows, float(self.rows.t[0])
        floor = max(self.floor.R, ROUND_OFF)
        few = slice(0, 2 * STARTING)
        spin = rows.omega if rows.R is None and rows.frame == fk.BODY else None
        parts = [None if part is None else part[few] for part in (rows.R, rows.x, spin)]
        late = choose(ff.clocks(rows.t[few], parts, exact), floor)
        frames: dict[float, Choice] = {}
        if rows.R is not None:
            for zero in dict.fromkeys((0.0, -first)):
                choice = ff.frames(rows.R, exact(rows.t + zero)[1], self.ways, floor)
                if choice is not None:
                    frames[zero] = choice
        price = math.log(EACH)
        gains = {zero: choice.gain - (price if zero else 0.0) for zero, choice in frames.items()}
        zero = max(gains, key=gains.__getitem__, default=0.0)
        if late.winner is not None and late.gain > gains.get(zero, 0.0) - price:
            zero, frames = late.winner.value, {}
        if zero:
            after = late.winner or frames[zero].winner
            assert after is not None
            self.tell(findings.of_shift(zero, first, self.step), late.now.misfit, after.misfit)
            self.rows = rows._replace(t=rows.t + zero)
        if zero in frames:
            self.frames(frames[zero], exact)

    def frames(self, choice: Choice, exact: ff.Exact) -> None:
        """Take the rotations in other readings and axes."""
        assert choice.winner is not None
        frame, off = choice.winner.value, (choice.now.misfit, choice.winner.misfit)
        self.read(frame.reading, *off)
        self.W, self.B = W, B = frame.W, frame.B
        if self.rows.x is not None and np.allclose(W @ B, ONE) and not np.allclose(W, ONE):
            right = exact(self.rows.t)[0]
            hand = choose(maps(self.rows.x @ W.T, right), max(self.floor.x / (size(right) or 1.0), ROUND_OFF))
            if hand.winner is not None and np.allclose(hand.winner.value, -ONE):
                self.tell(findings.of_hand(findings.triple(-W)), *off)
                self.rows = self.rows._replace(x=-self.rows.x)
                return
        if not np.allclose(W, ONE):
            self.tell(findings.of_world(W, self.body), *off)
        if not np.allclose(B, ONE):
            self.tell(findings.of_body(B, self.body), *off)

    def read(self, reading: str, before: float, after: float) -> None:
        """Take the rotations in another reading."""
        if reading:
            self.tell(findings.of_reading(reading), before, after)
            assert self.rows.R is not None
            R = next(R for name, _, R in fk.readings(self.rows.R, self.ways) if name == reading)
            self.rows, self.ways = self.rows._replace(R=R), {}

    def start(self, exact: ff.Exact) -> None:
        """Another start, of rows in which nothing else is wrong."""
        rows, first = self.rows, slice(0, STARTING)
        if rows.t[0] or rows.R is None or not self.is_clear:
            return
        _, E, Omega = exact(rows.t[first])
        off = [rotvec(rows.R[first] @ E.transpose(0, 2, 1))]
        words = f"the rotation is off by {np.linalg.norm(off[0][0]):.3g} rad"
        if rows.omega is not None:
            right = Omega if rows.frame == fk.BODY else np.einsum("kij,kj->ki", E, Omega)
            off.append((rows.omega[first] - right) / (size(right) or 1.0))
            words += f", ω by {np.linalg.norm(rows.omega[0] - right[0]):.3g} rad/s"
        # noise changes from row to row, another start does not
        most = 0.0
        for v in off:
            if size(v) > EACH * size(np.diff(v, axis=0)):
                most = max(most, float(np.linalg.norm(v[0])))
        if most > ANOTHER_START:
            self.tell(Words("other-start", f"the rows start elsewhere: {words}", "--start first-row"), most, 0.0)

    # ---------------------------------------------------------------- by the rows themselves

    def motion(self) -> None:
        """What turns the body, and what changes its momentum."""
        rows = self.rows
        if rows.R is not None:
            rate, blur = fk.rates(rows.t, rows.R)
            speed = size(rate)
            seen = speed if self.exact is None else max(speed, size(self.exact(rows.t)[2]))
            noise = self.floor.R / (self.step * speed) + self.floor.t / self.step + ROUND_OFF if speed else math.inf
            is_coarse = self.step * seen > COARSE
            spin: Array | None = rate
            if rows.omega is not None and len(rows.t) >= RATES and speed and size(rows.omega):
                floor = max(noise + self.floor.omega / speed, CLEARLY * blur)
                spin = self.kinematics(rows.omega, rate, floor, is_coarse)
            if spin is not None and speed and not is_coarse:
                inner = slice(2, -2)
                noise = noise if spin is rate else self.floor.omega / speed + self.floor.R
                assert self.rows.R is not None
                self.law(self.rows.t[inner], self.rows.R[inner], spin, noise)
        elif (
            rows.omega is not None and not self.omega_alone(rows.omega) and rows.frame == fk.BODY and self.body.is_free
        ):
            speed = size(rows.omega)
            if speed and self.step * speed < COARSE:
                self.law(rows.t, fk.turned(rows.t, rows.omega), rows.omega, self.floor.omega / speed)

    def kinematics(self, omega: Array, rate: Array, floor: float, is_coarse: bool) -> Array | None:
        """Does ω turn the body? ω in the body at the rows 2 … N − 3, or what the rotations say of it; None if they are wrong."""
        rows = self.rows
        assert rows.R is not None
        choice = choose(fk.spins(rows.t, rows.R, omega, rows.frame, self.ways), floor)
        if (
            rows.angles is not None
            and not is_coarse
            and (is_told := self.angles(omega, rate, choice, floor)) is not None
        ):
            return is_told
        if choice.winner is None:
            in_body = omega if rows.frame == fk.BODY else np.einsum("kji,kj->ki", rows.R, omega)
            self.is_clear = choice.now.misfit < UNCLEAR
            return in_body[2:-2] if choice.now.misfit < TURNS else rate if self.is_clear else None
        spin, off = choice.winner.value, (choice.now.misfit, choice.winner.misfit)
        if self.step * abs(findings.factor_of(spin.M)) * size(omega) > COARSE:
            self.is_clear = False
            return None
        if self.is_product(spin, omega):
            self.tell(findings.of_product(spin.frame), *off)
            return None
        self.read(spin.reading, *off)
        self.tell(findings.of_spin(spin, rows.frame), *off)
        return fk.rates(rows.t, self.rows.R)[0] if spin.reading else rate  # type: ignore[arg-type]

    def angles(self, omega: Array, rate: Array, choice: Choice, floor: float) -> Array | None:
        """Is ω the rate of the angles? Then ω is wrong if the rotations obey the law, else the angles are."""
        rows, rival = self.rows, choice.winner or choice.now
        assert rows.angles is not None
        assert rows.R is not None
        best = min(fk.angle_rates(rows.t, rows.angles, omega), key=lambda model: model.score(floor), default=rival)
        if best.misfit > GOOD or best.score(floor) + math.log(CLEARLY) > rival.score(floor):
            return None
        inner = slice(2, -2)
        rest, terms = balance(rows.t[inner], self.W @ rows.R[inner] @ self.B, rate @ self.B, self.body)
        is_integrated = rest > GOOD * terms
        self.tell(findings.of_angles(is_integrated), choice.now.misfit, best.misfit)
        return rate[:0] if is_integrated else rate

    def is_product(self, spin: fk.Spin, omega: Array) -> bool:
        """Whether ω in the body is right, but the rotations turn as if it were in the world: a product on the wrong side."""
        rows = self.rows
        assert rows.R is not None
        if spin.reading or (rows.frame, spin.frame) != (fk.BODY, fk.WORLD) or not np.allclose(spin.M, ONE):
            return False
        other = np.einsum("kji,kj->ki", rows.R, omega)
        if self.exact is not None:
            first = slice(0, STARTING)
            right = self.exact(rows.t[first])[2] @ self.B.T
            return size(omega[first] - right) * CLEARLY < size(other[first] - right)
        R = self.W @ rows.R @ self.B
        read, turned = (balance(rows.t, R, w @ self.B, self.body)[0] for w in (omega, other))
        return read * CLEARLY < turned

    def omega_alone(self, omega: Array) -> bool:
        """ω without rotations, against the exact one; whether something is wrong."""
        if self.exact is None:
            return False
        _, E, Omega = self.exact(self.rows.t)
        frames = {fk.BODY: Omega, fk.WORLD: np.einsum("kij,kj->ki", E, Omega)}
        models = [
            Model(model.cost + (frame != self.rows.frame), model.misfit, fk.Spin("", frame, fk.ON_TIME, model.value))
            for frame, right in frames.items()
            for model in maps(omega, right, fk.SPEEDS.values())
        ]
        choice = choose(models, max(self.floor.omega / (size(Omega) or 1.0), ROUND_OFF))
        if choice.winner is not None:
            self.tell(findings.of_spin(choice.winner.value, self.rows.frame), choice.now.misfit, choice.winner.misfit)
        return choice.winner is not None

    def law(self, t: Array, R: Array, spin: Array, noise: float) -> None:
        """Moments, torques, gravity, and a cap on |ω|; noise : of the spin in the body, relative."""
        if len(spin) < FEWEST or len(spin) != len(t):
            return
        if (cap := fk.cap(spin if self.rows.omega is None else self.rows.omega)) is not None:
            self.tell(findings.of_cap(*cap), 1 - cap[1] / cap[0], 0.0)
            return
        omega = spin @ self.B
        windows = fl.Windows(t, self.W @ R @ self.B, omega, self.body)
        floor = CLEARLY * windows.blur + noise * size(omega @ windows.I) / windows.scale
        choice = choose(fl.laws(windows), floor)
        if choice.winner is not None and choice.now.misfit > WORTH:
            self.tell(findings.of_law(choice.winner.value, self.body), choice.now.misfit, choice.winner.misfit)

    def positions(self, x: Array) -> None:
        """Positions against those by the exact motion or by the rotations; of a flight without a start, the parabola."""
        rows, body, y = self.rows, self.body, x @ self.W.T
        R = None if rows.R is None else self.W @ rows.R @ self.B
        if body.fixed and R is not None:
            right = R @ body.com
        elif self.exact is not None:
            right = self.exact(rows.t)[0]
        else:
            if not body.fixed:
                self.flight(y)
            return
        floor = max(self.floor.x / (size(right) or 1.0), self.floor.R, ROUND_OFF)
        choice = choose(ff.places(rows.t, y, R, right, not body.fixed), floor)
        if choice.winner is not None:
            word, value = choice.winner.value
            self.tell(findings.of_place(word, value, body), choice.now.misfit, choice.winner.misfit)

    def flight(self, x: Array) -> None:
        """The acceleration of a flight: unit of length, axis up, gravity."""
        g, off = ff.parabola(self.rows.t, x)
        was = self.body.gravity
        strength, length = float(np.linalg.norm(was)), float(np.linalg.norm(g))
        error = float(np.linalg.norm(g - was)) / (strength or 1.0)
        if strength and off < WORTH and error > max(NEAR, CLEARLY * EACH * off):
            unit = findings.name_of(strength / length, ff.LENGTHS)
            if unit is not None:
                self.tell(findings.of_length(unit), error, off)
                g = g * ff.LENGTHS[unit]
            if np.linalg.norm(g - was) > NEAR * strength:
                self.tell(findings.of_gravity(g, self.body), error, off)


def balance(t: Array, R: Array, omega: Array, body: RigidBody) -> tuple[float, float]:
    """The sizes of I ω' + ω × I ω − m c × Rᵀg, which is 0 by Euler's equations, and of its terms."""
    L = omega @ fl.tensor(body)
    torque = np.cross(body.mass * body.com, body.gravity @ R) if body.fixed else np.zeros_like(L)
    change, gyro = np.gradient(L, t, axis=0), np.cross(omega, L)
    return size(change + gyro - torque), size(change) + size(gyro) + size(torque)
