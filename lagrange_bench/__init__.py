"""Everything a user needs, from one place.

    from lagrange_bench import LagrangeTop, integrate, METHODS      # the integrators
    from lagrange_bench import check                                # does a method keep its word? on a problem of yours, too
    from lagrange_bench import metrics, states, timing              # what the experiments measure with
    from lagrange_bench import drift, phase, work_precision         # questions: a few methods, as a frame and as figures
    from lagrange_bench import load                                 # stored rows, the published ones among them, as frames
    from lagrange_bench import judge                                # the trajectory of any program, by the exact motion
    from lagrange_bench import assert_drift, assert_order           # for the tests of your own method
    from lagrange_bench import explicit_stepper                     # for a method of your own, on any problem
    from lagrange_bench import FixedStepper, Kernel, compiled       # and with a kernel of your own

docs/how-it-is-built.md names the rooms of this package.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
