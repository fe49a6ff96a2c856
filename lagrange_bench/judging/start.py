"""The start of the exact motion by the rows themselves: by the first one, or by a fit of the first ones."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import Case
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rotation import as_rotation
from lagrange_bench.judging.frames import Frames

Array = np.ndarray
# rows that a fit takes
FITTED = 50
# residuals of a fit are noise if they change from row to row by so much of their size; a smooth error changes less
NOISE = 0.7


def started(start: str, case: Case, frames: Frames, rows: Mapping[str, Array]) -> tuple[Case, str]:
    """The case with the start of the first row, or with the one that fits the first rows best; and what to say of it.

    Of a free body ω alone is enough, for it does not depend on the attitude. A flying body gets the velocity that fits all
    positions best.
    """
    head = {name: values[: FITTED if start == "fit" else 1] for name, values in rows.items()}
    R, omega = frames.motion(head)
    has_rotation = bool(frames.attitudes(head))
    if omega is None and start == "fit" and has_rotation and len(R) > 1:
        steps = Rotation.from_matrix(R[0].T @ R[1]).as_rotvec() / (head["time"][1] - head["time"][0])
        first = steps
    elif omega is not None and (has_rotation or (kinds.free_body(case.body) and case.body.fixed)):
        first = omega[0]
    else:
        first = np.full(3, np.nan)
    if not np.all(np.isfinite(R[0])) or not np.all(np.isfinite(first)):
        raise ValueError(f"--start {start}: the first row needs a rotation and an angular velocity")
    flight = {} if case.body.fixed else dict(zip(("position", "velocity"), np.nan_to_num(frames.launch), strict=True))
    case = replace(case, rotation=Rotation.from_matrix(R[0]), omega_body=first, **flight, exact={})
    if start == "fit":
        return _fitted(case, head["time"][:, 0], R if has_rotation else None, omega)
    return case, "as the first row does"


def _fitted(case: Case, t: Array, R: Array | None, omega: Array | None) -> tuple[Case, str]:
    """The case with the start that fits these rows best, by least squares over rotation and ω; and what to say of it."""
    first, spin = as_rotation(case.rotation), np.asarray(case.omega_body, dtype=float)
    size = float(np.linalg.norm(spin)) or 1.0
    units = {"rad/s": omega, "rad": R}
    units = {unit: values for unit, values in units.items() if values is not None}

    def start(u: Array) -> Case:
        turn = Rotation.from_rotvec(u[3:]) if len(u) > 3 else Rotation.identity()
        return replace(case, rotation=turn * first, omega_body=spin + size * u[:3])

    def residuals(u: Array) -> Array:
        motion = start(u).solution(t)
        off = []
        if omega is not None:
            off.append((motion.omega_body - omega) / size)
        if R is not None:
            off.append(Rotation.from_matrix(motion.rotation.as_matrix().transpose(0, 2, 1) @ R).as_rotvec())
        return np.concatenate([np.nan_to_num(each) for each in off], axis=None)

    unknowns = 3 if R is None else 6
    if 3 * len(t) <= unknowns:
        return case, "as the first row does: there are too few to fit a start"
    fit = least_squares(residuals, np.zeros(unknowns))
    off = fit.fun.reshape(-1, len(t), 3)
    rms, changes = (np.sqrt(np.mean(each**2, axis=(1, 2))) for each in (off, np.diff(off, axis=1)))
    sizes = [size if unit == "rad/s" else 1.0 for unit in units]
    scatter = ", ".join(f"{value * scale:.2g} {unit}" for value, scale, unit in zip(rms, sizes, units, strict=True))
    noise = " from row to row: noise" if np.all(changes > NOISE * rms) and rms.max() > 1e-9 else ""
    return start(fit.x), f"so that it fits the first {len(t)} rows best; these are off by {scatter}{noise}"
