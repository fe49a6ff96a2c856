"""Draws a run as a moving picture: `Trajectory.animate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.integrators.checks import check_choice
from lagrange_bench.integrators.problem import kinds

if TYPE_CHECKING:
    from lagrange_bench.integrators.interface import Array

# from where the eye looks: azimuth and elevation in rad
AZIMUTH = 0.6
ELEVATION = 0.35
# the part of the run that is drawn behind a moving point: less where three points move
TRAIL = {1: 0.15, 3: 0.03}
# pixels per inch: 3 inches are wide enough for a page
DPI = 80


def directions(run: Any) -> Array:
    """The unit vectors that move, (N, k, 3): the axis of a top, or the three principal axes of a body."""
    if kinds.rigid_body(run.top):
        return (run.rotation.as_matrix() @ run.top.axes.T).transpose(0, 2, 1)
    if run.top.space.name != "e3":
        raise ValueError(f"{run.top!r} has no axis that could be drawn on a sphere")
    x = run.y[:, None, 3:6]
    return x / np.linalg.norm(x, axis=2, keepdims=True)


def animate(run: Any, path: Path, frames: int, seconds: float) -> Path:
    """See `Trajectory.animate`."""
    from matplotlib import animation
    from matplotlib import pyplot as plt

    check_choice(path.suffix.lower(), "the ending of the file's name", (".gif",))
    if len(run.t) < frames:
        raise ValueError(f"the run has {len(run.t)} states, fewer than {frames} frames: record more of them (every=1)")
    across = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    ahead = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
    projected = directions(run) @ np.stack([across, np.cross(ahead, across)], axis=1)
    around = np.linspace(0.0, 2 * np.pi, 181)
    figure, axes = plt.subplots(figsize=(3, 3), dpi=DPI, layout="constrained")
    axes.set(aspect="equal", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))
    axes.set_axis_off()
    axes.plot(np.cos(around), np.sin(around), color="0.8", linewidth=0.8)
    axes.plot(np.cos(around), np.sin(ELEVATION) * np.sin(around), color="0.85", linewidth=0.6)
    moving = []
    for k in range(projected.shape[1]):
        color = f"C{k}"
        if projected.shape[1] == 1:
            axes.plot(*projected[:, k].T, color=color, linewidth=0.4, alpha=0.3)
        (trail,) = axes.plot([], [], color=color, linewidth=1.4)
        (arm,) = axes.plot([], [], color=color, linewidth=2.5, marker="o", markevery=[1])
        moving.append((trail, arm))
    clock = axes.text(-1.05, -1.05, "", fontsize=8)
    rows = np.linspace(0, len(run.t) - 1, frames).astype(int)
    length = int(TRAIL[projected.shape[1]] * len(run.t))

    def show(row: int) -> list[Any]:
        for k, (trail, arm) in enumerate(moving):
            trail.set_data(*projected[max(row - length, 0) : row + 1, k].T)
            arm.set_data(*np.stack([np.zeros(2), projected[row, k]], axis=1))
        clock.set_text(f"t = {run.t[row]:.3g}")
        return [part for pair in moving for part in pair]

    film = animation.FuncAnimation(figure, show, frames=rows, blit=False)
    film.save(path, writer=animation.PillowWriter(fps=max(round(frames / seconds), 1)))
    plt.close(figure)
    return path
