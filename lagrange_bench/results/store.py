"""Results on disk. Each experiment has a journal, `<experiment>.jsonl`, with one line for each finished cell.

A line is a JSON object with its own SHA-256. It is on the disk before the next cell is stored, and it is never changed
afterwards. A run that is killed loses only the cells that it was computing. A line that was cut off or damaged is reported and
skipped. If a cell has several records, the last that succeeded counts.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import math
import numbers
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.catalogue import declared
from lagrange_bench.results import provenance, sources
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.support.source_digest import Sources
from lagrange_bench.support.words import suggestion

if TYPE_CHECKING:
    import pandas as pd

Record = dict[str, Any]

ADDED = ("key", "status", "failure")  # columns that `rows` adds to the columns of a cell
SAMPLES = re.compile(r"(^|_)samples(_|$)")  # names of row fields that may be lists of numbers: raw timings
REFERENCE = Path(__file__).resolve().with_name("reference")  # the published rows, which come with the package
NAMES = (REFERENCE.name, "quick", "full")  # words that name results in place of a path
LONGEST = 2000  # characters of a message
COMPUTED: Record = {"rows": [], "error": None, "warnings": [], "seconds": 0.0}  # the outcome of a cell by default


class StoreError(RuntimeError):
    """Results cannot be written or read. The message names the folder and says what to do."""


def default_results(profile: str | None = None) -> Path:
    """The folder of results if the user names none: the published ones, or those of a run with this profile.

    A run in a clone writes to lagrange_bench/results/local/<profile>, from any folder, and an installed package to
    ./results/<profile>.
    """
    if profile is None:
        return REFERENCE
    root = provenance.checkout()
    return (Path("results") if root is None else root / "lagrange_bench" / "results" / "local") / profile


def folder_of(word: str) -> Path:
    """The folder of results that a word names: one of NAMES, from any folder, or a path. ./quick is a path."""
    if word not in NAMES:
        return Path(word)
    return REFERENCE if word == REFERENCE.name else default_results(word)


def name_of(folder: Path) -> str | None:
    """The name in NAMES of a folder of results; None if it has none."""
    place = os.path.abspath(folder)
    return next((name for name in NAMES if os.path.abspath(folder_of(name)) == place), None)


def find_results(chosen: str | Path | None) -> Path:
    """The folder of results with this name (in NAMES) or path; None: the one that the report shows.

    Raises
    ------
    FileNotFoundError : there is no such folder, or nothing is stored there.
    """
    folder = default_results() if chosen is None else folder_of(chosen) if isinstance(chosen, str) else chosen
    if not folder.is_dir():
        if name := name_of(folder):
            command = f"lagrange-bench run --profile {name}"
            raise FileNotFoundError(f"there is no {name} run yet in {os.path.abspath(folder)}: compute it, {command}")
        raise FileNotFoundError(
            f"no such folder of results: {folder}{suggestion(str(folder), NAMES)} Known: {', '.join(NAMES)}"
        )
    if not any(path.stat().st_size for path in folder.glob("*.jsonl")):
        raise FileNotFoundError(f"nothing is stored in {folder}: give a folder that lagrange-bench run wrote to")
    return folder


def cell_key(experiment: str, version: int, cell: Mapping[str, Any], own_sources: str | None = None) -> str:
    """SHA-256 of all that decides whether a cell is stored: experiment, its VERSION, the cell, versions of packages.

    own_sources : digest of the files of the user's own method or potential. So a run computes these cells again after an edit.
    """
    content = {"experiment": experiment, "version": version, "cell": clean(cell), "packages": _packages()}
    if own_sources is not None:
        content["source"] = own_sources
    return _digest(content)


def make_record(experiment: str, version: int, position: int, cell: Mapping[str, Any], **outcome: Any) -> Record:
    """A record without its SHA-256. position : of the cell in the list of its experiment; `rows` come in this order.

    outcome : the fields that differ from `COMPUTED`; an `error` means that the cell failed. If another process computed the
    cell, `sources` and `own_sources` are its digests (None: not known). If another machine did, `provenance` is its own.
    """
    outcome = {**COMPUTED, "status": "failed" if outcome.get("error") else "done", **outcome}
    if "sources" not in outcome:
        outcome |= sources.of_cell(experiment, cell).digests
    key = cell_key(experiment, version, cell, outcome.get("own_sources"))
    head = {"key": key, "experiment": experiment, "version": version, "position": position}
    return {"provenance": provenance.provenance(), **head, "cell": clean(cell), **outcome}


def clean_rows(cell: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> list[Record]:
    """Rows as they will be stored.

    Raises
    ------
    TypeError : a value is not a scalar, nor a list of numbers under a name like `seconds_samples`. ValueError : a row
    contradicts its cell or uses a name of ADDED.
    """
    cleaned = []
    for row in rows:
        row = clean(row)
        for name, value in row.items():
            if name in ADDED:
                raise ValueError(f"row field {name!r}: this name is reserved by the store")
            if name in cell and value != clean(cell[name]):
                raise ValueError(f"row field {name!r} is {value!r}, in the cell it is {cell[name]!r}")
            if isinstance(value, list) and SAMPLES.search(name) and all(type(v) in (int, float) for v in value):
                continue
            if isinstance(value, list) or (isinstance(value, dict) and set(value) != {"float"}):
                raise TypeError(f"row field {name!r} must be a scalar; got a {type(value).__name__}")
        cleaned.append(row)
    return cleaned


def clean(value: Any) -> Any:
    """`value` in plain JSON types: NumPy scalars become Python's, tuples lists, NaN and ±inf {"float": "nan"}."""
    if value is None:
        return None
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Mapping):
        if bad := [name for name in value if not isinstance(name, str)]:
            raise TypeError(f"field names must be strings; got {bad[0]!r}")
        return {name: clean(content) for name, content in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(content) for content in value]
    if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b":
        return bool(value)
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Real):
        return float(value) if math.isfinite(value) else {"float": repr(float(value))}
    raise TypeError(f"cannot store {value!r} of type {type(value).__name__}: not a JSON scalar")


def text_of(value: Any) -> str:
    """str(thing), at most LONGEST characters."""
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def failure_text(error: Mapping[str, str]) -> str:
    """What went wrong, in a line."""
    return f"{error['type']}: {error['message']}"


def restore(value: Any) -> Any:
    """Undoes what `clean` does to NaN and ±inf."""
    if isinstance(value, dict):
        return float(value["float"]) if set(value) == {"float"} else {k: restore(v) for k, v in value.items()}
    return [restore(v) for v in value] if isinstance(value, list) else value


def latest(records: Sequence[Record], version: float | None = None) -> list[Record]:
    """One record for each cell of this VERSION of an experiment, in the order of its cells.

    If there are none of this VERSION, the newest VERSION is taken. Of several records of a cell, those of the last environment
    and sources count; among these a success counts more than a failure, and a later one more than an earlier one.
    """
    versions = {record["version"] for record in records}
    chosen_version = version if version in versions else max(versions, default=None)
    chosen: dict[str, Record] = {}
    for record in (record for record in records if record["version"] == chosen_version):
        cell = _canonical(record["cell"])
        if _counts(record, chosen.get(cell)):
            chosen[cell] = record
    return [chosen[cell] for cell in sorted(chosen, key=lambda cell: (chosen[cell]["position"], cell))]


def _counts(record: Record, old: Record | None) -> bool:
    """Whether a record replaces an earlier one of its cell."""
    if old is None or old["status"] != "done" or record["status"] == "done":
        return True
    return (record["key"], record.get("sources")) != (old["key"], old.get("sources"))


@cache
def _packages() -> dict[str, str | None]:
    return {package: provenance.version(package) for package in provenance.DECISIVE}


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _digest(value: Any) -> str:
    return hashlib.sha256(_canonical(value).encode("ascii")).hexdigest()


class Journal(NamedTuple):
    """What is stored of one experiment: one record for each cell, and what is wrong with damaged lines."""

    latest: list[Record]
    problems: list[str]

    def done(self) -> dict[str, str | None]:
        """Keys of the computed cells, each with the digest of its sources."""
        return {record["key"]: record.get("sources") for record in self.latest if record["status"] == "done"}

    def source_ages(self) -> Counter[str]:
        """How many cells are SAME, OTHER, OUTDATED or UNKNOWN, by `sources.judge`."""
        present = Sources()
        return Counter(sources.judge(record, present) for record in self.latest)

    def rows(self) -> pd.DataFrame:
        """All measured rows, each with the fields of its cell and with `key`, `status` and `failure`.

        A failed cell is one row with status "failed" and the error's message; its measured columns are missing.
        Everywhere else status is "done" and `failure` is missing.
        """
        table = []
        for record in self.latest:
            failure = record["error"] and failure_text(record["error"])
            added = {"key": record["key"], "status": record["status"], "failure": failure}
            for row in record["rows"] if record["status"] == "done" else [{}]:
                table.append(restore({**record["cell"], **row, **added}))
        return _frame(table, columns=None if table else list(ADDED))

    def provenance(self) -> pd.DataFrame:
        """Where the rows of each cell come from: `key`, `seconds` and the facts of `provenance.provenance`."""
        return _frame([{"key": r["key"], "seconds": r["seconds"], **r["provenance"]} for r in self.latest])


def _frame(table: list[dict[str, Any]], columns: list[str] | None = None) -> pd.DataFrame:
    """A frame whose texts are Python's, whether or not pyarrow is installed."""
    import pandas as pd

    with pd.option_context("mode.string_storage", "python"):
        return pd.DataFrame(table, columns=columns)


class Store:
    """The journals in one folder. A store reads and creates nothing before one of its methods is called.

    Parameters
    ----------
    folder : str or Path
        Where the journals are.
    choice : Choice
        The cells that `open` and `rows` return. `append` writes all.
    """

    def __init__(self, folder: str | Path, choice: Choice = ALL):
        self.folder, self.choice = Path(folder), choice

    def path(self, experiment: str) -> Path:
        return self.folder / f"{experiment}.jsonl"

    def append(self, *records: Record) -> None:
        """Add records to their journals. On return they are on the disk. StoreError if that fails."""
        journals: dict[str, list[bytes]] = {}
        for record in records:
            line = _canonical({**record, "sha256": _digest(record)}).encode("ascii") + b"\n"
            journals.setdefault(record["experiment"], []).append(line)
        try:
            for experiment, lines in journals.items():
                _append(self.path(experiment), b"".join(lines))
        except OSError as error:
            text = f"cannot write results to {self.folder}: {error.strerror or error}. What was stored before is kept."
            advice = "help this folder, or choose another with --results DIR, and run the same command again."
            raise StoreError(f"{text} To go on: {advice}") from error

    def experiments(self) -> list[str]:
        """Names of the experiments that have a journal here, in the order of the page: the user's own come first."""
        stored = sorted(path.stem for path in self.folder.glob("*.jsonl") if path.is_file())
        return [
            *(name for name in stored if name not in EXPERIMENTS),
            *(name for name in EXPERIMENTS if name in stored),
        ]

    def read(self, experiment: str) -> tuple[list[Record], list[str]]:
        """Every record of an experiment, oldest first, and what is wrong with damaged lines.

        StoreError if the journal cannot be read.
        """
        path, records, problems = self.path(experiment), [], []
        try:
            with path.open("rb") as file:
                _lock(file.fileno(), exclusive=False)  # nobody is in the middle of a line
                *lines, last = file.read().split(b"\n")
        except FileNotFoundError:
            return [], []
        except OSError as error:
            raise StoreError(f"cannot read {path}: {error.strerror}") from error
        for number, line in enumerate([*lines, last], 1):
            record = _parse(line)
            if record is not None and record["experiment"] == experiment:
                records.append(record)
            elif line:
                damage = "damaged" if number <= len(lines) else "cut off while it was written"
                problems.append(f"{path}, line {number}: {damage}; skipped, its cell counts as not computed")
        return records, problems

    def open(self, experiment: str) -> Journal:
        """Read what is stored of an experiment now: the records that `latest` takes, of the present VERSION."""
        records, problems = self.read(experiment)
        shown = [r for r in latest(records, declared(experiment, "VERSION")) if self.choice.takes(r["cell"])]
        if len({record["version"] for record in records}) > 1:
            chosen = (record["cell"] for record in records if self.choice.takes(record["cell"]))
            older = set(map(_canonical, chosen)) - {_canonical(record["cell"]) for record in shown}
            left_out = f"{len(older)} cells of another VERSION of the experiment are left out"
            problems += [f"{self.path(experiment)}: {left_out}"] if older else []
        return Journal(shown, problems)

    def rows(self, experiment: str) -> pd.DataFrame:
        """All measured rows of an experiment; see `Journal.rows`."""
        return self.open(experiment).rows()


def _parse(line: bytes) -> Record | None:
    """The record in a line; None if its SHA-256 does not match."""
    head, _, tail = line.rpartition(b'"sha256":"')
    digest, mark, rest = tail[:64], tail[64:66], head + tail[66:]
    if mark != b'",' or hashlib.sha256(rest).hexdigest().encode() != digest:
        return None
    record: Record = json.loads(rest)  # whoever made the digest wrote a record
    return record


def _append(path: Path, lines: bytes) -> None:
    """Write lines at the end of a journal, on a fresh line, and sync them. Readers skip a line that is cut off."""
    path.parent.mkdir(parents=True, exist_ok=True)
    file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        _lock(file, exclusive=True)
        size = os.fstat(file).st_size
        if size and os.pread(file, 1, size - 1) != b"\n":
            lines = b"\n" + lines  # the last writer was cut off
        written = 0
        while written < len(lines):  # a full disk takes a part first, and says why only when asked again
            written += os.write(file, lines[written:])
        os.fsync(file)
    finally:
        os.close(file)


def _lock(file: int, exclusive: bool) -> None:
    """Lock a file until it is closed."""
    with contextlib.suppress(OSError):  # some network file systems have none
        fcntl.flock(file, fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH)
