"""Numbers and names as a reader sees them, here and on the page; tables as HTML cells, Markdown, LaTeX (booktabs, siunitx), CSV.

Measured numbers have three digits: 0.0171, 1.23×10⁻⁵. Counts are exact: 1024, 47 369. Powers of ten are 10⁴, 10⁻¹². CSV holds
every digit.
"""

import math
import numbers
import re
import unicodedata
from contextlib import suppress
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.integrators.interface import Method
from lagrange_bench.integrators.registry import METHODS, find_stored

MISSING = "–"
WHOLE = 10**7  # whole numbers up to here are counts, even as floats
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
GROUP = "\N{NARROW NO-BREAK SPACE}"
UNIT = re.compile(r"\bus\b")
NUMBER = re.compile(r"(?<![\w.])-?\d(?:\.\d+)?e[+-]?\d{1,3}(?!\w|\.\d)")
OF_METHODS = ("method", "cheapest", "best of the others")  # columns of methods: a paper wants labels, not keys


def flat(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with plain strings as names of columns. Its index becomes columns, unless it only counts rows."""
    counts = frame.index.names == [None] and pd.api.types.is_integer_dtype(frame.index.dtype)
    return frame.reset_index(drop=counts).rename(columns=str)


def heading(column: Any) -> str:
    """The name of a column for a reader: setup_us is "setup µs", 1e-06 is 10⁻⁶."""
    return numbers_in(UNIT.sub("µs", str(column).replace("_", " ")))


def cells(frame: pd.DataFrame) -> list[list[tuple[str, str | None]]]:
    """The rows of a frame, for the page: of each value the text, and the key by which it is sorted, if that is not the text."""
    return [[(show(value), _sort_key(value)) for value in row] for row in _rows(frame)]


def markdown(frame: pd.DataFrame) -> str:
    """A pipe table."""
    sides = ["--:" if _is_numeric(frame[name]) else ":--" for name in frame.columns]
    lines = [[heading(name) for name in frame.columns], sides, *(map(show, row) for row in _rows(frame))]
    escaped = ([" ".join(text.replace("|", r"\|").split()) for text in line] for line in lines)
    return "".join(f"| {' | '.join(line)} |\n" for line in escaped)


def latex(frame: pd.DataFrame, caption: str = "") -> str:
    r"""A `tabular` to \input into a table float, with columns of siunitx."""
    frame = frame.assign(**{name: frame[name].map(label, na_action="ignore") for name in OF_METHODS if name in frame})
    numeric = [name for name in frame.columns if _is_numeric(frame[name])]
    columns = {name: [tex(value, name in numeric) for value in frame[name]] for name in frame.columns}
    body = pd.DataFrame({_tex_text(heading(name)): texts for name, texts in columns.items()})
    table = body.style.hide(axis="index").to_latex(
        column_format="".join("S" if name in numeric else "l" for name in columns),
        hrules=True,
        siunitx=True,
    )
    note = f"% {' '.join(caption.split())}\n" if caption else ""
    return f"% written by lagrange-bench report; needs \\usepackage{{booktabs,siunitx}}\n{note}{table}"


def csv(frame: pd.DataFrame) -> str:
    """Comma separated values: every digit, empty fields for missing values."""
    return str(frame.to_csv(index=False, lineterminator="\n"))


def record_of(method: str) -> Method | None:
    """The record of a method; None if it cannot be loaded here."""
    with suppress(Exception):
        return find_stored(method, METHODS)
    return None


def label(method: str) -> str:
    """The name of a method in tables and sentences; in a figure see `style.of`. A method without a record keeps its name."""
    record = record_of(method)
    return printable(record.label if record else method)


def printable(text: str) -> str:
    return "".join(c for c in text if c == "\n" or not unicodedata.category(c).startswith("C"))


def show(value: Any) -> str:
    """A value for a reader."""
    if not _is_number(value):
        return _word(value)
    mantissa, exponent = _digits(value)
    if exponent is None:
        return mantissa.replace("-", "−").replace(" ", GROUP)
    factor = {"1": "", "-1": "−"}.get(mantissa, f"{mantissa.replace('-', '−')}×")
    return f"{factor}10{str(exponent).translate(SUPERSCRIPT)}"


def numbers_in(text: str) -> str:
    """A text with its numbers as `show` writes them: 1e-06 is 10⁻⁶."""
    return NUMBER.sub(lambda match: show(float(match[0])), text)


def tex(value: Any, is_among_numbers: bool = False) -> str:
    """As `show`, for LaTeX: a number as siunitx reads it; a text among numbers stands in braces."""
    if not _is_number(value):
        text = _tex_text(_word(value))
        return f"{{{text}}}" if is_among_numbers else text
    mantissa, exponent = _digits(value)
    if mantissa.endswith("∞"):
        return "{$" + mantissa.replace("∞", r"\infty") + "$}"
    return mantissa.replace(" ", "") + ("" if exponent is None else f"e{exponent}")


def _digits(value: Any) -> tuple[str, int | None]:
    """Mantissa and power of ten, in ASCII except for ∞. Counts are exact, in groups of three from five digits on."""
    value = float(value) + 0.0  # no −0
    if math.isinf(value):
        return "∞" if value > 0 else "-∞", None
    mantissa, power = f"{value:.2e}".split("e")
    mantissa, exponent = mantissa.rstrip("0").rstrip("."), int(power)
    is_power = exponent >= 4 and abs(value) == 10.0**exponent
    if value.is_integer() and abs(value) < WHOLE and not is_power:
        whole = f"{value:,.0f}" if abs(value) >= 10_000 else f"{value:.0f}"
        return whole.replace(",", " "), None
    if not -3 <= exponent < 4:
        return mantissa, exponent
    return np.format_float_positional(float(f"{value:.2e}"), trim="-"), None


def _rows(frame: pd.DataFrame) -> list[tuple[Any, ...]]:
    """The values of a frame row by row; pandas would make floats of integers."""
    return list(zip(*(frame.iloc[:, i].array for i in range(frame.shape[1])), strict=True))


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not pd.api.types.is_bool(value) and not pd.isna(value)


def _is_numeric(values: pd.Series) -> bool:
    """Whether a column has numbers, and nothing else that is shown."""
    known = [value for value in values if show(value) != MISSING]
    return bool(known) and all(map(_is_number, known))


def _word(value: Any) -> str:
    if pd.api.types.is_bool(value):
        return "yes" if value else "no"
    return MISSING if value is None or (pd.api.types.is_scalar(value) and pd.isna(value)) else numbers_in(str(value))


def _sort_key(value: Any) -> str | None:
    if _is_number(value):
        return repr(float(value))
    return "" if show(value) == MISSING else None


def _tex_text(text: str) -> str:
    from pylatexenc.latexencode import unicode_to_latex

    return str(unicode_to_latex(text.replace(GROUP, "\N{NO-BREAK SPACE}"), unknown_char_policy="ignore"))
