"""Tools of measurement: initial states, metrics, timing, checks of claims, golden bits."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["metrics", "states", "timing"])
