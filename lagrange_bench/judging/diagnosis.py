"""Why do rows leave the motion of a rigid body? A few least-squares fits of physical laws, and one rule that chooses (`fits`).

    clock        |Θ'| = unit · |ω|,  x = x₀ + v t + g t²/2     unit of time, a constant that is added to the times
    frames       R_exact = W R B,  x_exact = M W x + m         axes, hand, order of quaternions, unit of length, origin
    kinematics   M ω = Θ'                                      frame, unit, sign, axes and time of ω
    law          Δ(R I Ω) = ∫ m c × g dt + Σ a T               moments, gravity, damping, gyroscopic torque, explicit step

Each fit looks at the rows as the findings before it mend them, so that two mistakes are both named. A wrong finding is worse than
none: a law that holds to 3e-3 needs no cause, rows that are far apart are asked for their frames only, and digits hide misfits.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators import RigidBody
from lagrange_bench.judging import fits_frames as ff
from lagrange_bench.judging import fits_kinematics as fk
from lagrange_bench.judging import fits_law as fl
from lagrange_bench.judging.findings import Finding, of_axes, of_unit, say, triple
from lagrange_bench.judging.fits import CLEARLY, EACH, GOOD, Model, ModelChoice, choose, factor_of, maps, name_of
from lagrange_bench.judging.vectors import FAR, NEAR, ONE, Array, rotvec, size, steps, to_body, to_world

# at most so many first rows are looked at
MOST = 2000
# and at most so many findings are named
MOST_FINDINGS = 3
# fewer rows show nothing
FEWEST = 4
# and fewer show no rates
RATES = 12
# rad between rows, beyond which turns may be others than they seem
COARSE = 1.0
# and beyond which the step of a program may explain what is left of its law
LAWFUL = 0.55
# rotations without ω and without a start must be nearer, for nothing else says that they do not turn farther
ALONE = 0.1
# and squared relative errors of their rates, beyond which the rates say nothing
BLURRED = 0.01
# a law that holds to this share needs no cause
WORTH = 3e-3
# ω that turn the body to this share are right
TURNS = 0.02
# and if they are off by more than that and none of the causes is clear, nothing can be said of the law
UNCLEAR = 0.2
# relative, or rad: a start that is off by less is no other start; so many first rows tell it from noise
ANOTHER_START, STARTING = 0.05, 9
# beside these causes another start is named
ASIDE = ("time-unit", "omega", "length", "origin")
# causes beside which ω may be in the other frame, and so many times it must be nearer in that one
READINGS = ("quaternion-order", "rotation-transposed", "rotation-angles")
NEARER = 10.0
# causes beside which ω is right as it is read
POOR_STEPS = ("omega-half-step", "explicit-step")
# a law that is off by more of its size does not hold
HOLDS = 0.05
# and rows whose law is off so many times more than in most are named
APART = 100.0
# misfits below it are round-off
ROUND_OFF = 1e-9
CLOCK_NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds", "min": "minutes"}
# how near to a unit of time the ratio of two speeds must be
ALIKE = {"ms": 0.4, "us": 0.4, "ns": 0.4, "min": 0.03}


class BodyRows(NamedTuple):
    """What a file says: times (N,), s; matrices (N, 3, 3), ω (N, 3) in `frame`, positions (N, 3), angles (N, 3) in rad, or None.

    Rotations take the body to the world. angles : the columns from which the rotations come, if they are angles.
    """

    t: Array
    R: Array | None = None
    omega: Array | None = None
    x: Array | None = None
    frame: str = fk.BODY
    angles: Array | None = None


ALL_DIGITS = {"time": 0.0, "rotation": 0.0, "omega": 0.0, "position": 0.0}


class Diagnosis:
    """Rows of a body as the findings so far mend them, in the axes of the case if these are found.

    At most 2000 first rows are looked at; rows with a NaN are left out. other_readings : the option → matrices (N, 3, 3) of the
    rotations as it reads them; that they may be transposed need not be said. exact : times (n,) → positions, matrices, and ω in
    the body of the exact motion, NaN where they are not known; None without a start. floor : the errors that the digits of the
    file hide, s, rad, rad/s, m. is_clear : ω turns the body, or it is known why not.
    """

    def __init__(
        self,
        rows: BodyRows,
        other_readings: Mapping[str, Array],
        body: RigidBody,
        exact: ff.Exact | None = None,
        floor: Mapping[str, float] = ALL_DIGITS,
    ):
        good = np.isfinite(rows.t)
        for part in (rows.R, rows.omega, rows.x):
            if part is not None:
                good &= np.isfinite(part).reshape(len(good), -1).all(1)
        keep = np.flatnonzero(good)[:MOST]
        R, omega, x, angles = (
            part if part is None else part[keep] for part in (rows.R, rows.omega, rows.x, rows.angles)
        )
        self.rows = BodyRows(rows.t[keep], R, omega, x, rows.frame, angles)
        self.other_readings = {name: R[keep] for name, R in other_readings.items()}
        self.body, self.exact, self.floor = body, exact, floor
        self.is_clear, self.found = True, list[Finding]()

    @np.errstate(all="ignore")
    def findings(self) -> list[Finding]:
        """What is wrong, in at most three findings, the first cause first; [] if nothing is clear."""
        if len(self.rows.t) < FEWEST:
            return []
        self.time_unit()
        if self.exact is not None:
            self.times_and_frames(self.exact)
        self.motion()
        if self.rows.x is not None:
            self.positions(self.rows.x)
        if self.exact is not None and all(each.cause.startswith(ASIDE) for each in self.found):
            self.start(self.exact)
        if all(each.cause in READINGS for each in self.found):
            self.frame_of_omega()
        return self.found[:MOST_FINDINGS]

    def add(self, findings: Finding | Iterable[Finding], before: float, after: float) -> None:
        """Add findings, unless their cause is named already."""
        for each in [findings] if isinstance(findings, Finding) else findings:
            if all(each.cause != finding.cause for finding in self.found):
                self.found.append(each._replace(before=float(before), after=float(after)))

    @property
    def step(self) -> float:
        """The time between two rows."""
        return float(np.median(np.diff(self.rows.t)))

    def in_body(self, omega: Array | None) -> Array | None:
        """ω in the body; None if that cannot be known."""
        if omega is None or self.rows.frame == fk.BODY:
            return omega
        return None if self.rows.R is None else to_body(self.rows.R, omega)

    # ---------------------------------------------------------------- by the clock and the exact motion

    def time_unit(self) -> None:
        """How fast the rows turn or fly, over how fast they should: a unit of time?"""
        ratio = self.speed_ratio()
        for unit, factor in fk.CLOCKS.items():
            # degrees that were taken for radians turn some 57 times too fast, which is no minute
            alike = ALIKE[unit] if self.rows.angles is None else 0.1 * ALIKE[unit]
            if abs(ratio / factor - 1) < alike:
                self.clock(factor, abs(ratio - 1), abs(ratio / factor - 1))
                return
        if self.exact is not None and self.rows.R is not None:
            self.time_unit_of_turns(self.exact, self.rows.R)

    def time_unit_of_turns(self, exact: ff.Exact, R: Array) -> None:
        """The unit of time in which rows that may be too far apart for rates are near the exact motion."""
        before = ff.distance((R, None, None), exact(self.rows.t))
        for factor in fk.CLOCKS.values():
            right = exact(self.rows.t * factor)
            off = ff.distance((R, None, None), right)
            if off < GOOD * size(rotvec(right[1] @ right[1][:1].transpose(0, 2, 1))) and not before < off / GOOD:
                self.clock(factor, before, off)
                return

    def clock(self, factor: float, before: float, after: float) -> None:
        """Take the times as so many times what they say."""
        unit = name_of(factor, fk.CLOCKS)
        if unit is None:
            self.add(say("time-unit unnamed", factor=1 / factor), before, after)
        else:
            self.add(say("time-unit", unit=unit, name=CLOCK_NAMES[unit]), before, after)
        self.rows = self.rows._replace(t=self.rows.t * factor)
        self.floor = {**self.floor, "time": self.floor["time"] * factor}

    def speed_ratio(self) -> float:
        """How fast the rows turn or move by their own times, over how fast by the exact motion, by ω, or by gravity."""
        rows, start = self.rows, slice(0, 4)
        now, right, dt = math.nan, math.nan, np.diff(rows.t[start])[:, None]
        if self.exact is not None:
            moment = 1e-6 * min(1.0, float(dt[0, 0]))
            x, _, omega = self.exact(np.array([0.0, moment]))
            if rows.R is not None:
                now, right = size(steps(rows.R[start]) / dt), float(np.linalg.norm(omega[0]))
            elif rows.x is not None:
                now, right = size(np.diff(rows.x[start], axis=0) / dt), float(np.linalg.norm(x[1] - x[0])) / moment
        elif rows.R is not None and rows.omega is not None:
            now, right = size(fk.rates(rows.t, rows.R)[0]), size(rows.omega)
        elif rows.x is not None and not self.body.fixed:
            return self.fall(rows.x)
        return now / right if right else math.nan

    def times_and_frames(self, exact: ff.Exact) -> None:
        """A constant of the times, or the reading and the axes of the rotations; whatever is clearer, then times once more."""
        rows, late, price = self.rows, self.lateness(exact), math.log(EACH)
        zero, choice, gain = 0.0, None, 0.0
        for shift in dict.fromkeys((0.0, -float(rows.t[0]))):
            if rows.R is None:
                break
            tried = ff.frames(
                rows.R, exact(rows.t + shift)[1], self.other_readings, max(self.floor["rotation"], ROUND_OFF)
            )
            if tried is not None and tried.gain - (price if shift else 0.0) > gain:
                zero, choice, gain = shift, tried, tried.gain - (price if shift else 0.0)
        if late.winner is not None and late.gain > gain - price:
            self.shift(late.winner.value, *late.misfits)
        elif choice is not None:
            if zero:
                self.shift(zero, late.now.misfit, choice.misfits[1])
            self.frames(choice, exact)
            if (late := self.lateness(exact)).winner is not None:
                self.shift(late.winner.value, *late.misfits)

    def lateness(self, exact: ff.Exact) -> ModelChoice:
        """The choice of a constant of the times, by the first rows."""
        rows, few = self.rows, slice(0, STARTING)
        in_body = rows.omega if rows.frame == fk.BODY else None
        parts = [part if part is None else part[few] for part in (rows.R, rows.x, in_body)]
        return choose(ff.clocks(rows.t[few], parts, exact), max(self.floor["rotation"], ROUND_OFF))

    def shift(self, constant: float, before: float, after: float) -> None:
        """Add a constant to the times."""
        self.add(ff.of_shift(constant, float(self.rows.t[0]), self.step), before, after)
        self.rows = self.rows._replace(t=self.rows.t + constant)

    def frames(self, choice: ModelChoice, exact: ff.Exact) -> None:
        """Take the rotations in other readings and axes."""
        assert choice.winner is not None
        (reading, W, B), off = choice.winner.value, choice.misfits
        self.read(reading, *off)
        rows = self.rows
        assert rows.R is not None
        R, x = W @ rows.R @ B, None if rows.x is None else rows.x @ W.T
        omega = None if rows.omega is None else rows.omega @ (B if rows.frame == fk.BODY else W.T)
        self.rows, self.other_readings = rows._replace(R=R, omega=omega, x=x), {}
        if x is not None and np.allclose(W @ B, ONE) and not np.allclose(W, ONE):
            right = R @ self.body.com if self.body.fixed else exact(rows.t)[0]
            hand = choose(maps(x, right), max(self.floor["position"] / (size(right) or 1.0), ROUND_OFF))
            if hand.winner is not None and np.allclose(hand.winner.value, -ONE):
                self.add(say("left-handed", axes=triple(-W)), *off)
                self.rows = self.rows._replace(x=-x)
                return
        if not np.allclose(W, ONE):
            self.add(of_axes("world", W, self.body.up), *off)
        if not np.allclose(B, ONE):
            self.add(of_axes("body", B.T, np.zeros(3) if self.body.axis is None else self.body.axis), *off)

    def read(self, reading: str, before: float, after: float) -> None:
        """Take the rotations in another reading."""
        if reading:
            self.add(fk.of_reading(reading), before, after)
            assert self.rows.R is not None
            R = next(R for name, _, R in fk.readings(self.rows.R, self.other_readings) if name == reading)
            self.rows, self.other_readings = self.rows._replace(R=R), {}

    def start(self, exact: ff.Exact) -> None:
        """Another start, of rows in which nothing else is wrong that concerns it."""
        rows, first = self.rows, slice(0, STARTING)
        if rows.t[0] or not self.is_clear or (rows.R is None and (rows.x is None or rows.omega is None)):
            return
        x, E, Omega = exact(rows.t[first])
        off = []  # of rotations in rad, else of positions, and of ω, relative
        if rows.R is not None:
            off.append(rotvec(rows.R[first] @ E.transpose(0, 2, 1)))
        elif rows.x is not None:
            off.append((rows.x[first] - x) / (size(x) or 1.0))
        if rows.omega is not None and not self.found and (rows.R is None or len(rows.t) >= RATES):
            right = Omega if rows.frame == fk.BODY else to_world(E, Omega)
            off.append((rows.omega[first] - right) / (size(right) or 1.0))
        # noise changes from row to row, another start does not
        clear = [float(np.linalg.norm(v[0])) for v in off if size(v) > EACH * size(np.diff(v, axis=0))]
        if clear and max(clear) > ANOTHER_START:
            self.add(say("other-start"), max(clear), 0.0)

    # ---------------------------------------------------------------- by the rows themselves

    def motion(self) -> None:
        """What turns the body, and what changes its momentum."""
        rows = self.rows
        if rows.omega is not None:
            self.cap("cap", rows.omega)
        if rows.R is not None:
            self.turning(rows.R)
        elif (
            rows.omega is not None and not self.omega_alone(rows.omega) and rows.frame == fk.BODY and self.body.is_free
        ):
            speed = size(rows.omega)
            if speed and self.step * speed < COARSE:
                self.law(rows.t, fk.turned(rows.t, rows.omega), rows.omega, self.floor["omega"] / speed)
        if rows.omega is not None and all(each.cause in POOR_STEPS for each in self.found):
            self.decay(rows.omega)

    def decay(self, omega: Array) -> None:
        """Whether the spin about the axis of symmetry falls to a cap, or like exp(−c t): the exact one is constant."""
        axis, in_body = self.body.axis, self.in_body(omega)
        if axis is None or in_body is None:
            return
        t, spin = self.rows.t - self.rows.t[0], np.abs(in_body @ axis)
        fall = np.log(spin / spin[0])
        if self.cap("cap spin", spin[:, None]):
            return
        rate = -float(fall @ t / (t @ t))
        off = float(np.abs(fall + rate * t).max())
        if fall[-1] < -0.01 and off < 0.1 * abs(fall[-1]):
            self.add(say("damping spin", rate=rate), -fall[-1], off)

    def turning(self, R: Array) -> None:
        """Does ω turn the body, and does the law change it?"""
        rows, widest = self.rows, COARSE
        rate, blur = fk.rates(rows.t, R)
        if not (speed := size(rate)):
            return
        noise = self.floor["rotation"] / (self.step * speed) + self.floor["time"] / self.step + ROUND_OFF
        spin: Array | None = rate
        if rows.omega is not None and len(rows.t) >= RATES and size(rows.omega):
            spin = self.kinematics(rows.omega, rate, noise + self.floor["omega"] / speed, blur)
        elif self.exact is None:
            widest = ALONE
        if spin is None or self.rows.R is None:
            return
        noise = noise if spin is rate else self.floor["omega"] / speed + self.floor["rotation"]
        fastest = size(spin) if self.exact is None else max(size(spin), size(self.exact(self.rows.t)[2]))
        if self.step * fastest < widest and fk.rates(self.rows.t, self.rows.R)[1] < BLURRED:
            self.law(self.rows.t[2:-2], self.rows.R[2:-2], spin, noise)

    def kinematics(self, omega: Array, rate: Array, floor: float, blur: float) -> Array | None:
        """ω in the body at the rows 2 … N − 3 if it turns the body, else the rates of the rotations; None if these are wrong."""
        rows = self.rows
        assert rows.R is not None
        choice = choose(fk.spins(rows.t, rows.R, omega, rows.frame, self.other_readings), floor)
        off = choice.misfits
        if rows.angles is not None and blur < BLURRED:
            cause = self.angle_cause(rows.angles, omega, rate, choice, max(floor, CLEARLY * blur))
            if cause:
                return None if cause == "angles-integrated" else rate
        if choice.winner is None:
            in_body = self.in_body(omega)
            self.is_clear = choice.now.misfit < UNCLEAR
            if in_body is not None and choice.now.misfit > WORTH:
                part = choose((choice.now, fk.lateness(rows.t[2:-2], in_body[2:-2], rate)), max(floor, CLEARLY * blur))
                if part.winner is not None:
                    late = part.winner.value
                    side = "late" if late > 0 else "early"
                    self.add(say("omega-half-step part", late=abs(late), side=side), *part.misfits)
                    return rate
            if in_body is not None and choice.now.misfit < TURNS:
                return in_body[2:-2]
            return rate if self.is_clear else None
        spin = choice.winner.value
        self.is_clear = self.is_dense(omega, factor_of(spin.M), choice.winner.misfit)
        if not self.is_clear:
            return None
        if self.is_product(spin, omega):
            self.add(say("rotation-product", frame=spin.frame), *off)
            self.add(fk.of_spin(spin._replace(frame=rows.frame), rows.frame), *off)
            return None
        self.read(spin.reading, *off)
        assert self.rows.R is not None
        rate, factor = fk.rates(rows.t, self.rows.R)[0], abs(factor_of(spin.M))
        unit = name_of(factor, fk.CLOCKS)
        ratio = float(np.median(np.linalg.norm(rate, axis=1) / np.linalg.norm(omega[2:-2], axis=1)))
        if unit is not None:
            ratio = fk.CLOCKS[unit]
        if unit is not None or (abs(ratio - 1) > NEAR and self.is_clock(rate, omega, ratio)):
            self.clock(ratio, *off)
            spin, rate = spin._replace(M=spin.M / factor), rate / ratio
        self.add(fk.of_spin(spin, rows.frame), *off)
        return rate

    def is_clock(self, rate: Array, omega: Array, factor: float) -> bool:
        """Whether the rates have a factor because the times have one: ω starts as the case does, or gravity is right so."""
        rows, inner = self.rows, slice(2, -2)
        assert rows.R is not None
        if self.exact is not None:
            right = float(np.linalg.norm(self.exact(np.zeros(1))[2][0]))
            return abs(float(np.linalg.norm(omega[0])) / right - 1) < NEAR
        if not self.body.fixed:
            return rows.x is not None and abs(self.fall(rows.x) / factor - 1) < NEAR
        t, R = rows.t[inner], rows.R[inner]
        read, other = (fl.Windows(t * c, R, rate / c, self.body).misfit() for c in (1.0, factor))
        return other * CLEARLY < min(read, GOOD)

    def fall(self, x: Array) -> float:
        """How much faster a flying body falls than it should, the root of its acceleration over g; NaN if unclear."""
        g, misfit, _ = ff.parabola(self.rows.t, x, 0.0)
        strength = float(np.linalg.norm(self.body.gravity)) or math.nan
        return math.sqrt(float(np.linalg.norm(g)) / strength) if misfit < WORTH else math.nan

    def is_dense(self, omega: Array, factor: float, misfit: float) -> bool:
        """Whether turns between rows are what they seem: if ω as read says no, then a unit must be exact, or ω the exact one."""
        angle, factor = self.step * size(omega), abs(factor)
        if angle < COARSE or (factor == 1 and angle < fk.ANOTHER_TURN):
            return True
        is_named = name_of(factor, fk.SPEEDS | fk.CLOCKS) is not None
        if self.exact is None:
            return is_named and misfit < WORTH and angle * factor < COARSE
        # the exact motion turns as fast, but for what else is wrong
        return is_named and abs(factor * size(omega) / (size(self.exact(self.rows.t)[2]) or math.inf) - 1) < ALIKE["ms"]

    def angle_cause(self, angles: Array, omega: Array, rate: Array, choice: ModelChoice, floor: float) -> str:
        """Which of ω and the angles is wrong if ω is the rate of the angles, more clearly than anything else; else "".

        ω is wrong if the rotations obey the law, else the angles are.
        """
        rows, inner, now = self.rows, slice(2, -2), choice.winner or choice.now
        assert rows.R is not None
        best = min(fk.angle_rates(rows.t, angles, omega), key=lambda model: model.score(floor))
        if not (best.misfit < GOOD and best.score(floor) + math.log(CLEARLY) < now.score(floor)):
            return ""
        law = fl.Windows(rows.t[inner], rows.R[inner], rate, self.body).misfit()
        cause = "angles-integrated" if law > GOOD else "angle-rates"
        self.add(say(cause), choice.now.misfit, best.misfit)
        return cause

    def is_product(self, spin: fk.Spin, omega: Array) -> bool:
        """Whether ω in the body is right, but the rotations turn as if it were in the world: a product on the wrong side."""
        rows = self.rows
        assert rows.R is not None
        factor = factor_of(spin.M)
        if spin.reading or (rows.frame, spin.frame) != (fk.BODY, fk.WORLD) or not np.allclose(spin.M, factor * ONE):
            return False
        omega = omega * factor
        other = to_body(rows.R, omega)
        if self.exact is not None:
            first = slice(0, STARTING)
            right = self.exact(rows.t[first])[2]
            return size(omega[first] - right) * CLEARLY < size(other[first] - right)
        read, turned = (size(fl.euler(rows.t, rows.R, w, self.body)) for w in (omega, other))
        return read * CLEARLY < turned

    def frame_of_omega(self) -> None:
        """The other frame of ω in rows that are too far apart for rates: by the means of ω between two rows."""
        rows = self.rows
        if rows.R is None or rows.omega is None:
            return
        other = fk.WORLD if rows.frame == fk.BODY else fk.BODY
        now, after = (fk.disagreement(rows.t, rows.R, rows.omega, frame) for frame in (rows.frame, other))
        if NEARER * after < min(now, 1.0):
            self.add(say("omega-frame", frame=other), now, after)

    def agreement(self) -> str:
        """How well rows in which nothing is found agree with themselves; empty if these are too few, or too far apart."""
        t, R, omega = self.rows.t, self.rows.R, self.in_body(self.rows.omega)
        if R is None or omega is None or len(t) < RATES:
            return ""
        off = fk.disagreement(t, R, omega, fk.BODY)
        if not math.isfinite(off) or size(omega) * self.step > COARSE:
            return ""
        windows = fl.Windows(t, R, omega, self.body)
        misfits = np.linalg.norm(windows.X @ windows.claimed, axis=1) / windows.scale
        law = float(np.median(misfits))
        holds = f"the law of motion {'holds to' if law < WORTH else 'is off by'} {law:.0e}"
        agree = f"ω and the rotations {'agree to' if off < WORTH else 'differ by'} {off:.0e}, {holds}"
        broken = misfits > max(HOLDS, APART * law)
        if not broken.any():
            return f"No cause is found: {agree}."
        when = float(t[int(np.argmax(broken)) + windows.w])
        where = (
            f"near t = {when:.4g} s it is off by {misfits.max():.0e}: look there for a cap on ω, a contact or a reset"
        )
        return f"No cause is found: {agree} in most rows; {where}."

    def omega_alone(self, omega: Array) -> bool:
        """ω without rotations, against the exact one; whether something is wrong."""
        if self.exact is None:
            return False
        _, E, Omega = self.exact(self.rows.t)
        frames = {fk.BODY: Omega, fk.WORLD: to_world(E, Omega)}
        models = [
            Model(model.cost + (frame != self.rows.frame), model.misfit, fk.Spin("", frame, fk.ON_TIME, model.value))
            for frame, right in frames.items()
            for model in maps(omega, right, fk.SPEEDS.values())
        ]
        choice = choose(models, max(self.floor["omega"] / (size(Omega) or 1.0), ROUND_OFF))
        if choice.winner is not None:
            self.add(fk.of_spin(choice.winner.value, self.rows.frame), *choice.misfits)
        return choice.winner is not None

    def cap(self, name: str, omega: Array) -> bool:
        """Whether |ω|, or the spin, falls to a cap. name : of the sentence."""
        speeds = fk.cap(omega)
        if speeds is not None:
            before, after = speeds
            self.add(say(name, before=before, after=after, degrees=math.degrees(after)), 1 - after / before, 0.0)
        return speeds is not None

    def law(self, t: Array, R: Array, spin: Array, noise: float) -> None:
        """Moments, torques, gravity; noise : of the spin in the body, relative."""
        if len(spin) < fl.FEWEST or len(spin) != len(t):
            return
        if any(finding.cause == "cap" for finding in self.found) or (self.rows.omega is None and self.cap("cap", spin)):
            return
        windows = fl.Windows(t, R, spin, self.body)
        floor = CLEARLY * windows.blur + noise * size(spin @ windows.I) / windows.scale
        # a law that holds so well needs no cause, and one that explains the rows so well no better one
        choice = choose(fl.laws(windows), max(floor, WORTH / 10))
        if choice.winner is None or choice.now.misfit < WORTH:
            return
        # a poor step of a program that turns far in it changes the law, too
        if self.step * size(spin) < LAWFUL or choice.gain > math.log(FAR):
            self.add(fl.of_law(choice.winner.value, self.body), *choice.misfits)

    def positions(self, x: Array) -> None:
        """Positions against those by the exact motion or by the rotations; of a flight without a start, the parabola."""
        rows, body, R = self.rows, self.body, self.rows.R
        if self.exact is not None:
            right, E, _ = self.exact(rows.t)
            start = self.exact(np.zeros(1))[0][0]
            R = E if R is None else R
        if body.fixed and R is not None:
            right = R @ body.com
            start = right[0] if self.exact is None else start
        elif self.exact is None:
            if not body.fixed:
                self.flight(x)
            return
        floor = max(self.floor["position"] / (size(right) or 1.0), self.floor["rotation"], ROUND_OFF)
        is_other = any(each.cause in ("body-axes", "moments", "gravity") for each in self.found)
        choice = choose(ff.places(rows.t, x, R, right, start, body, is_other), floor)
        if choice.winner is not None:
            self.add(choice.winner.value, *choice.misfits)

    def flight(self, x: Array) -> None:
        """The acceleration of a flight: unit of length, axis up, gravity."""
        (g, misfit, error), was = ff.parabola(self.rows.t, x, self.floor["position"]), self.body.gravity
        t = self.rows.t - self.rows.t[0]
        off, path, scale = x - t[:, None] ** 2 / 2 * was, ff.travelled(t, x), size(x - x.mean(0)) or 1.0
        slowed = ff.drag(*(ff.without_line(t, v) / scale for v in (off, path)))
        choice = choose((Model(0.0, misfit, 0.0), slowed), max(self.floor["position"] / scale, ROUND_OFF))
        if choice.winner is not None:
            self.add(say("linear-damping", rate=slowed.value), *choice.misfits)
            return
        strength, length = float(np.linalg.norm(was)), float(np.linalg.norm(g))
        least, off = max(NEAR * strength, error), float(np.linalg.norm(g - was))
        if strength and misfit < GOOD and off > least:
            if unit := name_of(strength / length, ff.LENGTHS):
                self.add(of_unit("length-unit", strength / length, ff.LENGTHS), off / strength, misfit)
                g = g * ff.LENGTHS[unit]
            if np.linalg.norm(g - was) > least:
                self.add(fl.of_gravity(g, self.body), off / strength, misfit)
