"""X"""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from integrators import Method

CONDA_NAMES = {"heyoka": "heyoka.py"}  # where conda-forge calls a package otherwise


def how_to_get(package: str) -> str:
    """Where a package that is not installed here comes from."""
    command = f"conda install -c conda-forge {CONDA_NAMES.get(package, package)}"
    return f"{package} is not installed here; it comes with {command} (on Linux also with pip)"


def find_method(name: str) -> Method:
    """The method of a registry name or of `package.module:METHOD`.

    Raises
    ------
    ValueError : there is none, or it cannot be loaded here; the message says why.
    """
    from integrators import METHODS, Method, available

    try:
        if ":" in name:
            search_current_folder()
            module, _, attribute = name.partition(":")
            method = getattr(importlib.import_module(module), attribute)
        else:
            method = METHODS[name]
    except KeyError as error:
        if Path(f"{name}.py").is_file():
            raise ValueError(
                f"no method is registered as {name!r}; for the one in {name}.py say {name}:METHOD"
            ) from None
        raise ValueError(str(error.args[0])) from None
    except Exception as error:  # importing somebody else's module may raise anything
        raise ValueError(f"method {name} cannot be loaded: {type(error).__name__}: {error}") from error
    if not isinstance(method, Method):
        raise ValueError(f"method {name} is a {type(method).__name__}, not an integrators.Method")
    if not available(method):
        raise ValueError(f"method {name}: {how_to_get(str(method.requires))}")
    return method


def find_stored_method(name: str) -> Method:
    """As `find_method`, of a name that results bring with them: no module is imported for `module:METHOD`."""
    module, colon, _ = name.partition(":")
    if colon and module not in sys.modules:
        raise ValueError(f"unknown method {name!r}; if it is your own, add --module {module}")
    return find_method(name)


def import_modules(names: Iterable[str]) -> None:
    """Imports the modules that the user names with --module, from the current folder too: results may name them then."""
    for name in names:
        search_current_folder()
        try:
            importlib.import_module(name)
        except Exception as error:  # somebody's own module may raise anything
            raise ValueError(f"--module {name} cannot be imported: {type(error).__name__}: {error}") from error


def search_current_folder() -> None:
    """Find modules in the current folder, as `python -m` does; after everything that is installed."""
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))


def closest(name: str, known: Iterable[str]) -> str:
    """A question for who mistyped a name; empty if nothing is near."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""
