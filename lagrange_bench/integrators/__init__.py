"""Geometric integrators for spinning tops, rigid bodies and problems of your own, behind one interface.

    from lagrange_bench.integrators import LagrangeTop, integrate
    trajectory = integrate(LagrangeTop(alpha=1.0), y0, h=0.1, steps=10_000, method="backlund", every=10)
    trajectory.t, trajectory.y, trajectory.invariants(), trajectory.work

`METHODS` lists the methods. The closed forms in `exact` judge them, and `reference` where there is no closed form.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
