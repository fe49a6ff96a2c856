"""Drawing tools of the experiments: the look of figures, SVG and PDF files, tables."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["style"])
