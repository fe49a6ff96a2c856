"""Tables of numbers in files that any program wrote: where the rows and the names of the columns are, and the numbers."""

import bz2
import codecs
import csv
import gzip
import itertools
import json
import lzma
import math
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lagrange_bench.judging.names import UNITS, unit_of

Array = np.ndarray
HEAD = 1 << 18  # characters in which the header and some rows must stand
SAMPLE = 400  # rows that are looked at before all are read
SEPARATORS = (";", "\t", "|", ",", None)  # None is blanks
COMMENT = re.compile(r"\s*(#+|%+|//+|!+)\s*")
RULE = re.compile(r"[-=+|:;,\s]*")  # a line that only divides, or a blank one
INLINE = re.compile(r"(^|\s)[#%].*")
MISSING = {"", "na", "n/a", "#n/a", "null", "none", "<na>", "nan", "nan(ind)", "missing", "nat"}  # behind a sign, too
ODD = re.compile(r"([-+]?)\d\.#(?:(INF)|IND|QNAN|SNAN|NAN)0*", re.IGNORECASE)  # of Microsoft's C library
VECTOR = re.compile(r"(?<![\w\])])[(\[{]{1,4}([-+.,;\s\ddDeEnaif]+)[)\]}]+")  # numbers in brackets: a cell, or a row
BETWEEN = re.compile(r"\s*[;,]\s+|\s+|;|,(?=[-+]?\d*\.)")  # the numbers of a vector; 0,5 may be one of them
JOIN = "\1"
NUMBER = re.compile(r"([-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+))(?:[eEdDqQ]([-+]?\d+)|([-+]\d{3}))?\s*([a-zA-Zµ°][\w°/]*)?")
NUMPY = re.compile(r"(?:np\.)?float\d+\((.*)\)")  # as Python 3 prints numbers of NumPy 2
ATOM = re.compile(r"\s*[A-Za-z]\w*(\s+[-+.\deE]+){3}.*")  # of an XYZ file
CLOCK = re.compile(r"(?:(\d+):)?(\d+):(\d\d(?:\.\d*)?)")  # hours, minutes, seconds
PLAIN = re.compile(r"\s*([-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)|)\s*", re.IGNORECASE)
NO_ROW = (
    "a table must have one header, then a line with all columns for each time; begin others with #, or leave them out"
)
OTHERS = {
    b"PK": "an archive or a spreadsheet: unpack it, or save the sheet as .csv",
    b"\x89HDF": "HDF5: save the table as .csv, .npz or .parquet, from MATLAB with save(…, '-v7')",
    b"MATLAB 7.3": "HDF5: write it from MATLAB with save(…, '-v7')",
    b"#ROSBAG": "a bag of ROS: write its topic as .csv",
    b"SQLite": "a data base, perhaps a bag of ROS 2: write its topic as .csv",
    b"(\xb5/\xfd": "packed by zstd: unpack it",
}
PACKED: dict[bytes, Callable[..., Any]] = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}


@dataclass
class FileTable:
    """What a file holds.

    names : of the columns; empty where the file has none. units : of columns, as a row of units says. sample : the first rows, as
    words. load : the numbers of some columns and the words of others, in all rows. above : the text over the rows.
    """

    names: list[str]
    width: int
    sample: list[list[str]]
    load: Callable[[Sequence[int], Sequence[int]], dict[int, Array]]
    units: dict[int, str] = field(default_factory=dict)
    above: str = ""

    def word(self, i: int) -> str:
        """The name of a column, or its index if it has none."""
        return (self.names[i] if self.names else "") or f"{i}"


def number(word: str, comma: bool = False) -> float:
    """The number that a word is, in SI units where it has a unit itself; NaN where it says that there is none.

    Raises
    ------
    ValueError : it is no number.
    """
    plain = word.strip().replace("−", "-")
    plain = numpy[1] if (numpy := NUMPY.fullmatch(plain)) else plain
    if plain.lower().lstrip("+-") in MISSING:
        return math.nan
    if (match := NUMBER.fullmatch(plain)) and (comma or "," not in match[1]):
        unit = unit_of(match[4]) if match[4] else UNITS["1"]
        if unit is not None:
            return float(f"{match[1].replace(',', '.')}e{match[2] or match[3] or 0}") * unit.factor
    if clock := CLOCK.fullmatch(plain):
        return 3600.0 * int(clock[1] or 0) + 60.0 * int(clock[2]) + float(clock[3])
    if odd := ODD.fullmatch(plain):
        return float(f"{odd[1]}inf") if odd[2] else math.nan
    if plain.lower().lstrip("+-") in ("inf", "infinity"):
        return float(plain)
    why = " (decimals need a point)" if re.fullmatch(r"[-+\d]+,\d+", plain) else ""
    why += "; without times in seconds, say --step SECONDS" if re.match(r"\d{4}-\d\d", plain) else ""
    raise ValueError(f"{word[:40]!r} is no number{why}")


def is_number(word: str, comma: bool = False) -> bool:
    """Whether a word is a number, or says that there is none."""
    try:
        number(word, comma)
    except ValueError:
        return False
    return True


def open_table(path: Path, indices: Sequence[int] = ()) -> FileTable:
    """The table in a file. indices : columns that hold numbers, as the user says.

    Raises
    ------
    ValueError : an empty or binary file, no numbers, text among them.
    """
    with path.open("rb") as file:
        if not file.seekable():
            raise ValueError("a pipe cannot be read twice; write a file")
        start = file.read(512)
    if not start.strip():
        raise ValueError("the file is empty")
    if start.startswith(b"\x93NUMPY"):
        return _of_arrays({"": np.load(path)})
    if path.suffix.lower() == ".npz":
        if not zipfile.is_zipfile(path):
            raise ValueError("this is no .npz file, or only a part of one: write it again")
        with np.load(path) as arrays:
            return _of_arrays(dict(arrays))
    if start.startswith(b"PAR1"):
        import pandas as pd

        frame = pd.read_parquet(path)
        return _of_arrays((frame.reset_index() if any(frame.index.names) else frame).to_dict("series"))
    for magic, kind in OTHERS.items():
        if start.startswith(magic):
            raise ValueError(f"this is {kind}")
    if start.startswith(b"MATLAB 5.0") or path.suffix.lower() == ".mat":
        from scipy.io import loadmat

        stored = loadmat(path, simplify_cells=True)
        if "Aclass" in stored:
            raise ValueError("this is a result of Modelica: write it as .csv")
        return _of_arrays({name: value for name, value in stored.items() if not name.startswith("__")})
    return Text(path, start).table(indices)


def _of_arrays(data: Mapping[str, Any]) -> FileTable:
    """Columns of arrays that have a row for each time, in their first or their last dimension."""
    arrays: dict[str, Array] = {}

    def collect(name: str, value: Any) -> None:
        if isinstance(value, Mapping) and all(str(key).isdecimal() for key in value):  # pandas numbers rows
            value = list(value.values())
        if isinstance(value, list) and all(isinstance(each, Mapping) for each in value):  # a row for each time
            value = {key: [row.get(key) for row in value] for key in dict.fromkeys(itertools.chain(*value))}
        elif isinstance(value, list) and all(
            isinstance(each, list) and each and isinstance(each[0], Mapping) for each in value
        ):
            value = {str(body): list(rows) for body, rows in enumerate(zip(*value, strict=True))}
        if isinstance(value, Mapping):
            for key, each in value.items():  # pandas has tuples for names in two lines
                word = ".".join(filter(None, map(str, key))) if isinstance(key, tuple) else str(key)
                collect(f"{name}.{word}" if name else word, each)
        else:
            array = np.asarray(value)
            if array.dtype.kind == "O":
                array = np.asarray([math.nan if each is None else each for each in array.ravel().tolist()])
            if array.ndim and array.size and array.dtype.kind in "fiubU":
                arrays[name] = array

    try:
        collect("", data)
    except ValueError:
        raise ValueError("its rows have not all the same numbers") from None
    lengths = Counter(n for array in arrays.values() for n in {array.shape[0], array.shape[-1]} if n > 1)
    clock = next((arrays[name] for name in ("t", "time") if name in arrays), None)
    n = clock.size if clock is not None else max(lengths, key=lambda k: (lengths[k], k), default=1)
    columns: dict[str, Array] = {}
    for name, array in arrays.items():
        array = array.reshape(-1) if array.size == n else array
        array = array if array.shape[0] == n else np.moveaxis(array, -1, 0)
        for place in np.ndindex(array.shape[1:]) if len(array) == n else ():
            columns[name + "".join(f"[{i}]" for i in place)] = array[(slice(None), *place)]
    if not columns:
        raise ValueError("there are no arrays of numbers in it with a row for each time")
    values = list(columns.values())

    def load(wanted: Sequence[int], words: Sequence[int]) -> dict[int, Array]:
        return {i: values[i].astype(str if i in words else float) for i in (*wanted, *words)}

    sample = [[str(value) for value in row] for row in zip(*(value[:SAMPLE] for value in values), strict=True)]
    return FileTable([] if "" in arrays else list(columns), len(values), sample, load)


class Text:
    """A text file: its beginning, from which is found how it is written, and its rows."""

    def __init__(self, path: Path, start: bytes):
        self.path = path
        self.open_bytes = next((opener for magic, opener in PACKED.items() if start.startswith(magic)), open)
        with self.open_bytes(path, "rb") as file:
            start = file.read(HEAD)
        self.encoding = _encoding(start)
        with self.open() as lines:
            text = lines.read(HEAD) if self.encoding else "\0"
        if len(text) == HEAD and "\n" in text:  # JSON may be a single line
            text = text[: text.rfind("\n") + 1]
        if "\0" in text or not text:
            raise ValueError("this is no text in UTF-8; write a text file with one row a line, .npz, .parquet or .mat")
        self.lines = text.split("\n")
        self.separator: str | None = None
        self.comma = False

    def open(self) -> Any:
        return self.open_bytes(self.path, "rt", encoding=self.encoding or "latin-1", errors="replace")

    def table(self, indices: Sequence[int]) -> FileTable:
        first = next(line.strip() for line in self.lines if line.strip())
        if re.match(r"\{\s*(\"|$)|\[\{|\[$|\[\[\[|\[\[.*\]\]$", first):
            return self._json(first)
        if first.isdecimal() and len(self.lines) > 2 and ATOM.fullmatch(self.lines[2]):
            return self._atoms(int(first))
        shown = [(i, line) for i, line in enumerate(self.lines) if not RULE.fullmatch(line)]
        rows = [(i, line) for i, line in shown if not COMMENT.match(line)]
        lines = [line for _, line in rows[: 2 * SAMPLE]]
        self.separator = max(SEPARATORS, key=lambda separator: _score(lines, separator))
        self.comma = self.separator != ","
        split = [(i, list(itertools.chain(*_cells(line, self.separator)))) for i, line in rows]
        a, b = _block([self._numeric(words, indices) for _, words in split])
        if a == b:
            last = f"; the last line is {lines[-1][:40]!r}" if lines else ""
            raise ValueError(f"there is no line of numbers in it{last}; write a table with a row for each time")
        block = split[a:b]
        numeric = (word for _, words in block for word in words if is_number(word, True))
        self.comma = self.comma and not any("." in word for word in numeric)
        self.skip, width = block[0][0], len(block[0][1])
        above = [line for i, line in shown if i < self.skip]
        header, units = self._header(above, [words for _, words in block])
        if not header and not any(words[-1] for _, words in block):  # rows end with a separator, the header does not
            block, width = [(i, words[:-1]) for i, words in block], width - 1
            header, units = self._header(above, [words for _, words in block])
        for i, words in block[:SAMPLE]:
            if len(words) != width:
                raise ValueError(f"line {i + 1}: {len(words)} columns instead of {width}; {NO_ROW}")
        numbers = {k for k, word in enumerate(block[0][1]) if word and is_number(word, self.comma)}
        for i, words in split[:a] + split[b:]:
            like = len(words) == width and all(words[k] and is_number(words[k], self.comma) for k in numbers)
            if i > self.skip or like:
                word = next((word for word in words if not is_number(word, self.comma)), "")
                text = f"{word[:40]!r} is no number" if word else f"{len(words)} columns instead of {width}"
                text = text if i > self.skip else f"numbers above the line of text {block[0][0]}"
                raise ValueError(f"line {i + 1}: {text}; {NO_ROW}")
        self.width, self.sample = width, [words for _, words in block[:SAMPLE]]
        return FileTable(header, width, self.sample, self._load, units, above="\n".join(self.lines[: self.skip]))

    def _numeric(self, words: list[str], indices: Sequence[int]) -> bool:
        """Whether a line is a row of numbers: at least half of its words are, or those that the user says."""
        if indices and all(i < len(words) and words[i] and is_number(words[i], self.comma) for i in indices):
            return True
        full = [word for word in words if word]
        return len(words) > 1 and bool(full) and 2 * sum(is_number(word, self.comma) for word in full) >= len(full)

    def _header(self, above: list[str], block: list[list[str]]) -> tuple[list[str], dict[int, str]]:
        """The names in the last line over the rows that has as many words, and the units in a line below it."""
        width, index = len(block[0]), [words[0] for words in block]
        sizes = [len(cell) for cell in _cells(self.lines[self.skip], self.separator)]
        counted = len(index) > 1 and index in ([str(k + first) for k in range(len(index))] for first in (0, 1))
        names: list[str] = []
        units: dict[int, str] = {}
        groups: list[list[str]] = []
        for line in reversed(above):
            text = COMMENT.sub("", line, count=1) if COMMENT.match(line) else line
            merged = re.sub(r"\s+([\[({])", r"\1", text)
            splits = [_words(text, self.separator), _words(merged, None), re.split(r"\s{2,}|\t", text.strip())]
            splits += [_words(text, ",")]
            if names:
                words = splits[0] + [""] * (len(names) - len(splits[0]))
                if len(words) == len(names) and any(words):
                    groups.append(words)
                continue
            for words in splits:
                while len(words) > width and not words[-1]:
                    words.pop()
                if 1 < len(words) == len(sizes) < width:  # one name for all the numbers in brackets
                    pairs = zip(words, sizes, strict=True)
                    words = [f"{word}[{k}]" if size > 1 else word for word, size in pairs for k in range(size)]
                if counted and len(words) == width - 1:  # R and pandas number rows, and have no name for that column
                    words = ["", *words]
                if len(words) != width or not any(word and not is_number(word, True) for word in words):
                    continue
                bare = [word.strip("[](){} ") for word in words]
                if not units and all(unit_of(word) for word in bare if word):
                    units = {k: word for k, word in enumerate(bare) if unit_of(word)}
                else:
                    names = words
                break
        for words in groups:  # X, Y, Z under Position and under Rotation; names in two lines
            filled = list(words)
            for k in range(1, len(filled)):
                filled[k] = filled[k] or filled[k - 1]
            if len(set(names)) < len(names):
                names = [f"{over}.{name}" if over else name for over, name in zip(filled, names, strict=True)]
            elif not all(names):
                names = [name or over for over, name in zip(words, names, strict=True)]
        return names, units

    def _json(self, first: str) -> FileTable:
        try:
            with self.open() as file:
                whole = first.startswith("[") or not first.endswith("}")
                data = json.load(file) if whole else [json.loads(line) for line in file if line.strip()]
            data = data[0] if isinstance(data, list) and len(data) == 1 else data
            if isinstance(data, dict) and isinstance(rows := data.get("data"), list):  # of pandas, "split" or "table"
                names = data.get("columns")
                data = [dict(zip(names, row, strict=True)) for row in rows] if names else rows
        except (ValueError, TypeError, RecursionError) as error:
            why = "it is nested too deep" if isinstance(error, RecursionError) else error
            raise ValueError(f"this is no JSON with a row a line, or an array for each name: {why}") from None
        return _of_arrays({"": data})

    def _atoms(self, count: int) -> FileTable:
        """The frames of an XYZ file: how many atoms, a line that may name the time, and a line for each atom."""
        with self.open() as file:
            lines = [line for line in file if line.strip()]
        frames = [lines[k : k + count + 2] for k in range(0, len(lines), count + 2)]
        time = re.compile(r"\b(?:time|t)\b\W*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)", re.IGNORECASE)
        times = [float(match[1]) for frame in frames if (match := time.search(frame[1]))]
        try:
            places = np.array([[line.split()[1:4] for line in frame[2:]] for frame in frames], dtype=float)
        except ValueError:
            raise ValueError(f"this is no XYZ file with {count} atoms in each frame") from None
        columns: dict[str, Any] = {f"atom{k + 1}": dict(zip("xyz", places[:, k].T, strict=True)) for k in range(count)}
        return _of_arrays({**({"t": times} if len(times) == len(frames) else {}), **columns})

    def _load(self, wanted: Sequence[int], words: Sequence[int]) -> dict[int, Array]:
        """The columns; the fast way is pandas, which knows nothing of D exponents, units and the like.

        A short file is read sooner than pandas is imported.
        """
        places, plain = sorted({*wanted, *words}), [row[i] for row in self.sample for i in wanted]
        if comma := self.comma and any("," in word for word in plain):
            plain = [word.replace(",", ".") for word in plain]
        long, simple = self.path.stat().st_size > HEAD, all(PLAIN.fullmatch(word) for word in plain)
        if long and simple and not any(INLINE.search(line) or VECTOR.search(line) for line in self.lines[self.skip :]):
            import pandas as pd

            settings: dict[str, Any] = {"sep": self.separator or r"\s+", "header": None, "skipinitialspace": True}
            settings |= {"usecols": places if len(places) < self.width else None, "decimal": "," if comma else "."}
            settings |= {"dtype": {i: str if i in words else float for i in places}, "keep_default_na": False}
            # a label may be empty, or "NA"; other words for a missing number are read line by line
            settings |= {"na_values": {i: ["", "-", "nan", "NaN"] for i in places if i not in words}}
            try:
                with self.open() as file:
                    for _ in range(self.skip):
                        file.readline()
                    frame = pd.read_csv(file, **settings)
                return {i: frame[i].to_numpy() for i in places}
            except (ValueError, OverflowError):
                pass  # read line by line, to see where
        columns: dict[int, list[Any]] = {i: [] for i in places}
        for line, row in self._rows():
            try:
                for i in places:
                    columns[i].append(row[i] if i in words else number(row[i], self.comma))
            except ValueError as error:
                raise ValueError(f"line {line}: {error}; {NO_ROW}") from None
        return {i: np.array(values, dtype=str if i in words else float) for i, values in columns.items()}

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        with self.open() as file:
            for line, text in enumerate(file, 1):
                if line > self.skip and not RULE.fullmatch(text) and not COMMENT.match(text):
                    words = list(itertools.chain(*_cells(text, self.separator)))
                    if len(words) < self.width or any(words[self.width :]):
                        text = f"{len(words)} columns instead of {self.width}"
                        raise ValueError(f"line {line}: {text}; {NO_ROW}")
                    yield line, words


def _score(lines: Sequence[str], separator: str | None) -> int:
    """How well a separator explains some lines: numbers count twice, words that are none once against it."""
    score = 0
    for line in lines:
        words = [word for word in itertools.chain(*_cells(line, separator)) if word]
        numeric = sum(is_number(word, separator != ",") for word in words)
        score += max(0, 3 * numeric - len(words)) if len(words) > 1 else 0
    return score


def _encoding(start: bytes) -> str:
    """utf-8-sig, utf-16, or the one-byte code of old programs; empty for what is no text."""
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if any(byte < 9 or 13 < byte < 32 for byte in start):
        return ""
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(start)  # the last letter may be cut
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _words(line: str, separator: str | None) -> list[str]:
    """The words of a line. separator : None for blanks."""
    line = line.strip(" \r\n") if separator else line.strip().rstrip(";,")
    if '"' in line:
        between = separator or " "
        row = next(csv.reader([line.replace("\t", between)], delimiter=between, skipinitialspace=True))
        return [word.strip(" \t'") for word in row]
    return [word.strip().strip("'") for word in line.split(separator)]


def _cells(line: str, separator: str | None) -> list[list[str]]:
    """The cells of a row, and the words of each: a vector in brackets has several."""
    joined = VECTOR.sub(lambda vector: JOIN.join(BETWEEN.split(vector[1].strip())), INLINE.sub("", line))
    return [cell.split(JOIN) for cell in _words(joined, separator)]


def _block(numeric: Sequence[bool]) -> tuple[int, int]:
    """The longest run of rows of numbers, of two equal ones the last."""
    best, start = (0, 0), 0
    for true, run in itertools.groupby(numeric):
        end = start + len(list(run))
        if true and end - start >= best[1] - best[0]:
            best = start, end
        start = end
    return best
