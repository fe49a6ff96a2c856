"""`integrate` for every problem: a top goes to `api`, a Gaudin magnet to `paper.gaudin_methods`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from integrators import api
from integrators.api import Trajectory
from integrators.checks import check_grid
from integrators.interface import Method
from integrators.problem.body import HeavyTop
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.top import LagrangeTop

if TYPE_CHECKING:
    from integrators.paper.gaudin_model import GaudinMagnet


def integrate(
    top: LagrangeTop | HeavyTop | PerturbedTop | GaudinMagnet,
    y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method = "backlund",
    every: int | None = None,
    t: ArrayLike | None = None,
    attitude: bool | ArrayLike = False,
    **options: Any,
) -> Trajectory:
    """Follow a top, or a magnet, from y0.

    Give either `h` and `steps`, or `t`. With `h` and `steps` every `every` steps are recorded (default: only the start
    and the end). With `t`, any times counted from that of y0, the method's dense output is used. The exact Bäcklund map takes one
    map for each time then: a jump, not a sequence of steps. With `t`, `backlund_splitting` chooses its step for `tol`
    and reports it in `work.notes`.

    Parameters
    ----------
    top : LagrangeTop, HeavyTop (time in s then), or PerturbedTop; or a GaudinMagnet, with h and steps only. y0 : (6,),
    initial (J, x); of a magnet its spins (n, 3). h : step, negative runs backwards. Times are in the top's own unit, 1 over
    the unit of J. steps : number of steps. method : a name in METHODS, or a Method; for a magnet a name in MAGNET_METHODS.
    every : must divide `steps`. t : (N,), finite. attitude : follow the whole body too: True, or its initial attitude as a
    unit quaternion (4,), scalar first; the body is that of a HeavyTop, or one with equal moments of inertia. options : the
    method's own.

    Returns
    -------
    a `Trajectory`: t (N,), y (N, 6), of a magnet (N, n, 3), work, and attitude (N, 4) if it was asked for.

    Raises
    ------
    ValueError : bad input; the message names the argument. StepError : the method failed.
    """
    if not isinstance(top, (LagrangeTop, HeavyTop, PerturbedTop)):
        from integrators.paper.gaudin_model import GaudinMagnet  # with mpmath: a top does not wait for it

        if isinstance(top, GaudinMagnet):
            if t is not None or (attitude is not False and attitude is not None):
                raise ValueError(f"{'attitude' if t is None else 't'}: not for a GaudinMagnet; give h and steps")
            return _integrate_magnet(top, y0, h, steps, method, every, options)
    return api.integrate(top, y0, h, steps, method, every, t, attitude, **options)


def _integrate_magnet(
    magnet: GaudinMagnet, spins: Any, h: Any, steps: Any, method: Any, every: Any, options: dict[str, Any]
) -> Trajectory:
    from integrators.paper.gaudin_methods import prepare_method

    if h is None or steps is None:
        raise ValueError("give h and steps")
    steps, every = check_grid(steps, every, "steps")
    stepper = prepare_method(magnet, spins, h, method, options)
    y = stepper.record(spins, steps, every)
    return Trajectory(magnet, method, api.grid_times(stepper.h, every, len(y)), y, stepper.work)
