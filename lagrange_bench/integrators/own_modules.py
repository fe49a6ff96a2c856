"""Imports the user's own modules, which a command line names, also from the current folder."""

import importlib
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType


def import_modules(names: Iterable[str]) -> None:
    """Import the modules that the user names with --module, so that stored results may name their methods and potentials."""
    for name in names:
        try:
            import_own(name)
        except Exception as error:  # somebody's own module may raise anything
            raise ValueError(f"--module {name} cannot be imported: {type(error).__name__}: {error}") from error


def import_own(module: str) -> ModuleType:
    """Import a module that the user names: from the current folder first, as `python -m` does, else as installed.

    The folder is first in sys.path during the import, and last from then on. So a file that is being edited is found before its
    installed copy, and a folder called `results` or `report` hides nothing of the bench later.
    """
    folder = str(Path.cwd())
    if "" not in sys.path and folder not in sys.path:
        sys.path.append(folder)
    sys.path.insert(0, folder)
    try:
        with no_exit():
            return importlib.import_module(module)
    finally:
        sys.path.remove(folder)


@contextmanager
def no_exit() -> Iterator[None]:
    """Turn the sys.exit() of an imported module into an ImportError. So it does not end this process."""
    try:
        yield
    except SystemExit as end:
        raise ImportError(f"it calls sys.exit({end.code!r})") from end
