"""`integrate` for every problem: a top goes to `api`, a Gaudin magnet to `paper.gaudin_methods`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from lagrange_bench.integrators import api
from lagrange_bench.integrators.api import Trajectory
from lagrange_bench.integrators.checks import check_grid
from lagrange_bench.integrators.interface import Method
from lagrange_bench.integrators.problem.body import RigidTop
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop

if TYPE_CHECKING:
    from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet


def integrate(
    top: LagrangeTop | RigidTop | PerturbedTop | Problem | GaudinMagnet,
    y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method = "backlund",
    every: int | None = None,
    t: ArrayLike | None = None,
    attitude: bool | ArrayLike = False,
    **options: Any,
) -> Trajectory:
    """Follow a top, a problem of your own, or a magnet, from y0.

    Give either `h` and `steps`, or `t`. With `h` and `steps` every `every` steps are recorded (default: only the start
    and the end). With `t`, any times counted from that of y0, the method's dense output is used. The exact Bäcklund map takes one
    map for each time then: a jump, not a sequence of steps. With `t`, `backlund_splitting` chooses its step for `tol`
    and reports it in `work.notes`.

    Parameters
    ----------
    top : LagrangeTop, RigidTop (time in s then), PerturbedTop, or Problem; or a GaudinMagnet, with h and steps only.
    y0 : (6,), initial (J, x); of a Problem as many numbers as its space has; of a magnet its spins (n, 3).
    h : step, negative runs backwards. Times are in the top's own unit, 1 over the unit of J.
    steps : number of steps. method : a name in METHODS, or a Method; for a magnet a name in MAGNET_METHODS.
    every : must divide `steps`. t : (N,), finite. attitude : True, or a unit quaternion (4,), scalar first: the initial attitude
    of a HeavyTop, or of the body with equal moments of inertia that a LagrangeTop is. A state from `RigidTop.state` has its own.
    options : the method's own.

    Returns
    -------
    a `Trajectory`: t (N,), y (N, 6), of a Problem (N, size), of a magnet (N, n, 3), and work; `rotation` where the start has
    one. Of a RigidTop also `position`, `omega_body`, `omega_world` and `energy`, in SI units. The rotation is followed when it
    is first asked for, by backlund, theta_functions and taylor.

    Raises
    ------
    ValueError : bad input; the message names the argument. StepError : the method failed.
    """
    if not isinstance(top, (LagrangeTop, RigidTop, PerturbedTop, Problem)):
        from lagrange_bench.integrators.paper.gaudin_model import (
            GaudinMagnet,  # with mpmath: a top does not wait for it
        )

        if isinstance(top, GaudinMagnet):
            if t is not None or (attitude is not False and attitude is not None):
                raise ValueError(f"{'attitude' if t is None else 't'}: not for a GaudinMagnet; give h and steps")
            return _integrate_magnet(top, y0, h, steps, method, every, options)
    return api.integrate(top, y0, h, steps, method, every, t, attitude, **options)


def _integrate_magnet(
    magnet: GaudinMagnet, spins: Any, h: Any, steps: Any, method: Any, every: Any, options: dict[str, Any]
) -> Trajectory:
    from lagrange_bench.integrators.paper.gaudin_methods import prepare_method

    if h is None or steps is None:
        raise ValueError("give h and steps")
    steps, every = check_grid(steps, every, "steps")
    stepper = prepare_method(magnet, spins, h, method, options)
    y = stepper.record(spins, steps, every)
    return Trajectory(magnet, method, api.grid_times(stepper.h, every, len(y)), y, stepper.work)
