"""Sweeps: a TOML file lists cells of an experiment, with tops, methods and steps of your own.

docs/sweeps.md explains such a file. The experiment measures, stores and draws the cells like its own. A field that the file
leaves out is taken from the first cell of the same part of the experiment. A cell on a top of the file holds the numbers of that
top, so it can be computed and drawn again without the file.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from lagrange_bench.experiments.catalogue import SCALED, load, with_units
from lagrange_bench.experiments.measuring.states import ACCURACY_OPTIONS, OPTIONS, SCHEME_OPTIONS, of_cell
from lagrange_bench.integrators.checks import check_real, check_state, check_step
from lagrange_bench.integrators.registry import NotInstalled, find_method
from lagrange_bench.integrators.start import is_taken
from lagrange_bench.support.files import read_toml
from lagrange_bench.support.words import suggestion

Cell = dict[str, Any]
LISTS = {
    "method": "methods",
    "state": "tops",
}  # field of a cell → key in a table, where they differ; see `with_units`


class Sweep(NamedTuple):
    """The content of a file: cells of an experiment, and a name for their results."""

    name: str
    experiment: str
    cells: list[Cell]


def read(path: Path) -> Sweep:
    """Read a sweep from a TOML file.

    Parameters
    ----------
    path : Path
        A TOML file.

    Returns
    -------
    Sweep
        Equal cells occur once.

    Raises
    ------
    ValueError
        The file has a mistake; the message says what and where, and suggests a name.
    """
    with _at(f"{path}, "):
        content = read_toml(path)
        _known(content, ("experiment", "tops", "sweep"))
        if not isinstance(experiment := content.get("experiment"), str):
            raise ValueError('experiment must be given, as experiment = "drift"')
        tops = {name: _top(name, table) for name, table in content.get("tops", {}).items()}
        templates: dict[str, Cell] = {}
        for cell in load(experiment).cells("quick"):
            templates.setdefault(cell.get("part", ""), cell)
        cells: dict[str, Cell] = {}
        tables = content.get("sweep")
        if not (isinstance(tables, list) and tables):
            raise ValueError("nothing to compute: add a table [[sweep]], with two brackets")
        for number, table in enumerate(tables, 1):
            with _at(f"[[sweep]] {number}, "):
                cells |= {repr(cell): cell for cell in _cells(experiment, table, tops, templates)}
    return Sweep(path.stem, experiment, list(cells.values()))


@contextmanager
def _at(place: str) -> Iterator[None]:
    """Put the place in the file before the message of an error in the block."""
    try:
        yield
    except (ValueError, TypeError, NotInstalled) as error:
        raise ValueError(f"{place}{error}") from None


def _known(table: Any, known: Iterable[str]) -> None:
    if not isinstance(table, dict):
        raise ValueError(f"it must be a table; got {table!r}")
    for key in table:
        if key not in known:
            raise ValueError(f"unknown key {key!r}{suggestion(key, known)} Known: {', '.join(known)}")


def _top(name: str, table: Any) -> Cell:
    """The fields of a cell on a top of the file."""
    with _at(f"[tops.{name}], "):
        if is_taken(name):
            raise ValueError("the bench has a top of this name; choose another")
        _known(table, ("alpha", "J", "x", "potential", "parameters"))
        if missing := [key for key in ("alpha", "J", "x") if key not in table]:
            raise ValueError(f"{', '.join(missing)} must be given")
        y0 = check_state([*table["J"], *table["x"]], "J and x")
        cell = {"state": name, "alpha": check_real(table["alpha"], "alpha"), "y0": _text(y0)}
        if "potential" in table:
            cell |= {"potential": table["potential"], "parameters": _text(table.get("parameters", ()))}
        of_cell(cell)
    return cell


def _text(values: Iterable[float]) -> str:
    return ",".join(repr(float(value)) for value in values)  # as the options of `integrate` take them


def _cells(experiment: str, table: Any, tops: Mapping[str, Cell], templates: Mapping[str, Cell]) -> Iterator[Cell]:
    """The cells of a table: all combinations of its lists."""
    part = table.get("part", next(iter(templates)))
    if part not in templates:
        raise ValueError(f"part: unknown {part!r}{suggestion(str(part), templates)} Known: {', '.join(templates)}")
    template = {word: value for word, value in templates[part].items() if word not in SCHEME_OPTIONS}
    words = dict.fromkeys((*template, *OPTIONS))
    keys = dict(zip(with_units(experiment, {**words, "part": part}), words, strict=False))
    keys = {LISTS.get(word, key): word for key, word in keys.items()}
    if old := [word for word in SCALED if word in table and f"{word}_scaled" in keys]:
        raise ValueError(f"{old[0]}: write {old[0]}_scaled = …, in the time scale of each top")
    _known(table, keys)
    lists = {keys[key]: value if isinstance(value, list) else [value] for key, value in table.items()}
    for key, word in keys.items():
        for value in lists.get(word, ()):
            _check(key, word, value, template)
    if missing := [key for word, key in LISTS.items() if word in template and word not in lists]:
        raise ValueError(f"{' and '.join(missing)} must be given, a list of names")
    for chosen in product(*lists.values()):
        cell = {**template, **dict(zip(lists, chosen, strict=True))}
        if "state" in cell:
            cell |= tops.get(cell["state"]) or {"state": cell["state"]}
            problem = of_cell(cell)[0]
            if "method" in cell and (reason := find_method(cell["method"]).takes(problem)):
                raise ValueError(
                    f"methods: {reason}: give the top {cell['state']} to others, in a [[sweep]] of their own"
                )
        yield cell


def _check(key: str, word: str, value: Any, template: Cell) -> None:
    """ValueError if a value has another type than in the experiment's own cells, or if the method is unknown."""
    if word == "method":
        find_method(value)
    elif word in ACCURACY_OPTIONS:
        check_step(value, key)
    elif type(template.get(word)) in (int, float):
        check_real(value, key)
    elif word in template and type(value) is not type(template[word]):
        raise ValueError(f"{key} must be a value such as {template[word]!r}; got {value!r}")
