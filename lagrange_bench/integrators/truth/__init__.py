"""The exact solution, and the reference solution for problems without one. They import no method."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["exact", "reference"])
