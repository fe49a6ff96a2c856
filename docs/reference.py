"""The reference: one offline page per module, from the docstrings. `make docs`, or python docs/reference.py [FOLDER].

pdoc reads modules as they are and asks for nothing: no second tree of sources, no theme, no configuration. Its pages carry
their style and their search index with them and fetch nothing from the network. Whatever it warns of is an error here.
"""

import importlib
import inspect
import os
import pkgutil
import sys
import types
import typing
import warnings
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiled kernels are Python functions then, with a signature and a docstring
os.environ["PDOC_ALLOW_EXEC"] = "1"  # of what our modules import, NumPy before 2.1 runs lscpu

ROOT = Path(__file__).resolve().parents[1]


def modules() -> list[str]:
    """All but the command lines."""
    names = ["lagrange_bench"]
    rooms = (f"lagrange_bench.{room}" for room in ("integrators", "experiments", "results"))
    for package in ("lagrange_bench", *rooms):
        path = importlib.import_module(package).__path__
        names += sorted({package, *(m.name for m in pkgutil.walk_packages(path, f"{package}."))} - set(names))
    return [name for name in names if not name.endswith("__main__")]


def write(folder: Path) -> list[str]:
    """Writes the pages; returns what there was to complain about."""
    from pdoc import doc, render

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        named = {name: doc.Module.from_name(name) for name in modules()}
        for name, module in named.items():
            # pdoc by itself leaves out what a package does not list in __all__
            below = [other for other in named if other.rpartition(".")[0] == name]
            vars(module)["submodules"] = [named[other] for other in below]
            prepare_annotations(module.obj)
        render.configure(docformat="numpy", footer_text="lagrange-bench")
        pages = {f"{name.replace('.', '/')}.html": render.html_module(module, named) for name, module in named.items()}
        pages |= {"index.html": render.html_index(named), "search.js": render.search_index(named)}
    for name, page in pages.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(page, encoding="utf-8")
    return [str(warning.message) for warning in caught]


def prepare_annotations(module: types.ModuleType) -> None:
    """ArrayLike is shown by its name, not by all it stands for; named tuples know the names in their annotations."""
    if hasattr(module, "ArrayLike"):
        module.ArrayLike = type("ArrayLike", (), {"__module__": "numpy.typing"})
    for _, thing in inspect.getmembers(module, inspect.isclass):
        if issubclass(thing, tuple) and thing.__module__ == module.__name__:
            thing.__new__.__annotations__ = typing.get_type_hints(thing)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "docs"
    if complaints := write(target):
        sys.exit("\n".join(complaints))
    print(target / "index.html")
