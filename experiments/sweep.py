"""Sweeps: cells of an experiment that a TOML file lists, with tops, methods and steps of your own.

docs/sweeps.md explains such a file. The experiment measures, stores and draws its cells as it does its own. What the file leaves
out is as in the first cell of that part of the experiment. A cell on a top of the file carries its numbers: no file is needed to
compute it again, or to draw it.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring.states import KNOBS, OPTIONS, find, of_cell
from lagrange_bench.integrators.checks import check_real, check_state, check_step
from lagrange_bench.integrators.registry import NAMED_TOPS, NotInstalled, find_method
from lagrange_bench.support.files import read_toml
from lagrange_bench.support.words import suggestion

Cell = dict[str, Any]
FIELDS = {"methods": "method", "tops": "state"}  # keys of a table and of a cell, where they differ


class Sweep(NamedTuple):
    """What a file asks for: cells of an experiment, and a name for their results."""

    name: str
    experiment: str
    cells: list[Cell]


def read(path: Path) -> Sweep:
    """Read a file.

    Parameters
    ----------
    path : Path
        A TOML file.

    Returns
    -------
    Sweep
        Its cells, each once.

    Raises
    ------
    ValueError
        What is wrong, and where in the file; and what may have been meant.
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
        tables = content.get("sweep", [])
        for number, table in enumerate(tables if isinstance(tables, list) else (), 1):
            with _at(f"[[sweep]] {number}, "):
                cells |= {repr(cell): cell for cell in _cells(table, tops, templates)}
        if not cells:
            raise ValueError("nothing to compute: add a table [[sweep]], with two brackets")
    return Sweep(path.stem, experiment, list(cells.values()))


@contextmanager
def _at(place: str) -> Iterator[None]:
    """What goes wrong inside is said with its place in the file."""
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
    """What a cell says of a top of the file."""
    with _at(f"[tops.{name}], "):
        if name in NAMED_TOPS or re.fullmatch(r"(random|wide|close)\d{3}", name):
            raise ValueError("the bench has a top of this name; choose another")
        _known(table, ("alpha", "J", "x", "potential", "parameters"))
        if missing := [key for key in ("alpha", "J", "x") if key not in table]:
            raise ValueError(f"{', '.join(missing)} must be given")
        y0 = check_state([*table["J"], *table["x"]], "J and x")
        cell = {"state": name, "alpha": check_real(table["alpha"], "alpha"), "y0": _text(y0)}
        if "potential" in table:
            cell |= {"potential": table["potential"], "parameters": _text(table.get("parameters", ()))}
        elif "parameters" in table:
            raise ValueError("parameters: of which potential? Give potential = NAME, too")
        of_cell(cell)
    return cell


def _text(values: Iterable[float]) -> str:
    return ",".join(repr(float(value)) for value in values)  # as the options of `integrate` take them


def _cells(table: Any, tops: Mapping[str, Cell], templates: Mapping[str, Cell]) -> Iterator[Cell]:
    """The cells of a table: all combinations of what it lists."""
    part = table.get("part", next(iter(templates)))
    if part not in templates:
        raise ValueError(f"part: unknown {part!r}{suggestion(str(part), templates)} Known: {', '.join(templates)}")
    template = templates[part]
    keys = {word: key for key, word in FIELDS.items()}
    _known(table, [keys.get(word, word) for word in dict.fromkeys((*template, *OPTIONS))])
    lists = {FIELDS.get(key, key): value if isinstance(value, list) else [value] for key, value in table.items()}
    for word, values in lists.items():
        for value in values:
            _check(word, value, template)
    if missing := [keys[word] for word in FIELDS.values() if word in template and word not in lists]:
        raise ValueError(f"{' and '.join(missing)} must be given, a list of names")
    for chosen in product(*lists.values()):
        cell = {**template, **dict(zip(lists, chosen, strict=True))}
        if "state" in cell:
            cell |= tops.get(cell["state"]) or {"state": cell["state"]}
            with _at("tops: "):
                problem = of_cell(cell)[0] if cell["state"] in tops else find(cell["state"])[0]
            if "method" in cell and (reason := find_method(cell["method"]).takes(problem)):
                raise ValueError(
                    f"methods: {reason}: give the top {cell['state']} to others, in a [[sweep]] of their own"
                )
        yield cell


def _check(word: str, value: Any, template: Cell) -> None:
    """ValueError for a value of another kind than the experiment's own, and for a method that there is not."""
    if word == "method":
        with _at("methods: "):
            find_method(value)
    elif word in KNOBS:
        check_step(value, word)
    elif type(template.get(word)) in (int, float):
        check_real(value, word)
    elif word in template and type(value) is not type(template[word]):
        raise ValueError(f"{word} must be a value such as {template[word]!r}; got {value!r}")
