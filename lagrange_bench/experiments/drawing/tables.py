"""Numbers as a reader sees them, here and on the page; tables as HTML cells, Markdown, LaTeX (booktabs, siunitx), CSV.

Measured numbers have three digits: 0.0171, 1.23×10⁻⁵. Counts are exact: 1024, 47 369. Powers of ten are 10⁴, 10⁻¹². CSV holds
every digit.
"""

import math
import numbers
import re
from collections.abc import Callable
from itertools import groupby
from typing import Any, NamedTuple

import pandas as pd

MISSING = "–"
PAGE = 45  # rows that fit on a page of LaTeX
WHOLE = 10**7  # whole numbers up to here are counts, even as floats
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LEVEL = {raised: digit for digit, raised in SUPERSCRIPT.items()}
GROUP = "\N{NARROW NO-BREAK SPACE}"
BAR = "\N{COMBINING MACRON}"
UNIT = re.compile(r"\bus\b")
NUMBER = re.compile(r"(?<![\w.])-?\d(?:\.\d+)?e[+-]?\d{1,3}(?!\w|\.\d)")
DECIMAL = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
POWER = "".join(map(chr, LEVEL))
SYMBOL = re.compile(f"[{POWER}]+|.{BAR}?", re.DOTALL)

TEX_SPECIAL = {
    **{c: "\\" + c for c in "&%$#_{}"},
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", "\n": " ", "\r": " ",
    "[": "{[}", "*": "{*}",  # at the start of a row they would be an argument of the \\ before it
    "–": "--", "—": "---", "\N{NO-BREAK SPACE}": "~", GROUP: r"\,", "…": r"\ldots{}",
}  # fmt: skip
GREEK = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "ε": "varepsilon", "θ": "theta", "κ": "kappa",
    "λ": "lambda", "μ": "mu", "ν": "nu", "π": "pi", "ρ": "rho", "σ": "sigma", "τ": "tau", "φ": "varphi", "χ": "chi",
    "ψ": "psi", "ω": "omega", "Γ": "Gamma", "Δ": "Delta", "Θ": "Theta", "Λ": "Lambda", "Φ": "Phi", "Ω": "Omega",
}  # fmt: skip
TEX_MATH = {
    **{c: "\\" + name for c, name in GREEK.items()},
    "×": r"\times", "·": r"\cdot", "±": r"\pm", "−": "-", "≤": r"\leq", "≥": r"\geq", "≠": r"\neq", "≈": r"\approx",
    "∝": r"\propto", "∞": r"\infty", "→": r"\to", "∂": r"\partial", "∇": r"\nabla", "°": r"{}^{\circ}",
    "½": r"\frac{1}{2}", "√": r"\surd",
    **{c: f"{{}}_{{{d}}}" for c, d in zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True)},
}  # fmt: skip


class Cell(NamedTuple):
    """One cell of a table: its text, the key for sorting, and whether it is a number, at the right side."""

    text: str
    sort: str
    numeric: bool


def flat(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with plain strings as names of columns. Its index becomes columns, unless it only counts rows."""
    counts = frame.index.names == [None] and pd.api.types.is_integer_dtype(frame.index.dtype)
    frame = frame.reset_index(drop=counts)
    names = [" ".join(map(str, name)) if isinstance(name, tuple) else str(name) for name in frame.columns]
    return frame.set_axis([name.strip() for name in names], axis="columns")


def heading(column: Any) -> str:
    """The name of a column for a reader: setup_us is "setup µs", 1e-06 is 10⁻⁶, 32.0 is 32."""
    name = str(column)
    return show(float(name)) if DECIMAL.fullmatch(name) else UNIT.sub("µs", name.replace("_", " "))


def cells(frame: pd.DataFrame) -> list[list[Cell]]:
    """The rows of a frame, for the page."""
    return _body(frame, _cell)


def markdown(frame: pd.DataFrame) -> str:
    """A pipe table."""
    sides = [":--" if side == "l" else "--:" for side in _sides(frame)]
    lines = [[heading(name) for name in frame.columns], sides, *_body(frame, show)]
    escaped = ([" ".join(text.replace("|", r"\|").split()) for text in line] for line in lines)
    return "".join(f"| {' | '.join(line)} |\n" for line in escaped)


def latex(frame: pd.DataFrame, caption: str = "") -> str:
    r"""A `tabular` to \input into a table float, with numbers for siunitx; a `longtable` if it does not fit on a page."""
    long = len(frame) > PAGE
    body = pd.DataFrame(_body(frame, tex), columns=[_tex_text(heading(name)) for name in frame.columns])
    table = body.style.hide(axis="index").to_latex(
        column_format=f"@{{}}{''.join(_sides(frame))}@{{}}",
        environment="longtable" if long else None,
        caption=_tex_text(caption) if long and caption else None,
        hrules=True,
    )
    packages = "booktabs,siunitx,longtable" if long else "booktabs,siunitx"
    note = f"% {' '.join(caption.split())}\n" if caption else ""
    return rf"% written by lagrange-bench report; needs \usepackage{{{packages}}}" + f"\n{note}{table}"


def csv(frame: pd.DataFrame) -> str:
    """Comma separated values: every digit, empty fields for missing values, an apostrophe before a text like a formula."""
    plain = frame.map(_no_formula).set_axis([_no_formula(name) for name in frame.columns], axis="columns")
    return str(plain.to_csv(index=False, lineterminator="\n"))


def _no_formula(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "@")) else value


def show(value: Any, pad: bool | None = None) -> str:
    """A value for a reader. pad : whether a measured number keeps zeros at the end; None: the value may be a count."""
    if not _is_number(value):
        return _word(value)
    mantissa, exponent = _digits(_count(value) if pad is None else value, bool(pad))
    if exponent is None:
        return mantissa.replace("-", "−").replace(" ", GROUP)
    factor = {"1": "", "-1": "−"}.get(mantissa, f"{mantissa.replace('-', '−')}×")
    return f"{factor}10{str(exponent).translate(SUPERSCRIPT)}"


def numbers_in(text: str) -> str:
    """A text with its numbers as `show` writes them: 1e-06 is 10⁻⁶."""
    return NUMBER.sub(lambda match: show(float(match[0])), text)


def tex(value: Any, pad: bool | None = None) -> str:
    """As `show`, for LaTeX: siunitx prints the number."""
    if not _is_number(value):
        return _tex_text(_word(value))
    mantissa, exponent = _digits(_count(value) if pad is None else value, bool(pad))
    if mantissa.endswith("∞"):
        return "$" + mantissa.replace("∞", r"\infty") + "$"
    return rf"\num{{{mantissa.replace(' ', '')}{'' if exponent is None else f'e{exponent}'}}}"


def _count(value: Any) -> Any:
    """An integer, if the number is whole and not too large to be a count."""
    return int(value) if float(value).is_integer() and abs(value) < WHOLE else value


def _digits(value: Any, pad: bool) -> tuple[str, int | None]:
    """Mantissa and power of ten, in ASCII except for ∞. Whole numbers are exact, in groups of three from five digits on."""
    if isinstance(value, numbers.Integral):
        whole = int(value)
        zeros = len(str(whole)) - len(str(whole).rstrip("0"))
        if zeros >= 4 and abs(whole) == 10**zeros:
            return str(whole)[:-zeros], zeros
        return (f"{whole:,}".replace(",", " ") if abs(whole) >= 10_000 else str(whole)), None
    value = float(value)
    if math.isinf(value):
        return "∞" if value > 0 else "-∞", None
    if value == 0:
        return "0", None
    mantissa, power = f"{value:.2e}".split("e")
    exponent = int(power)
    scientific = not -3 <= exponent < 4
    decimal = mantissa if scientific else f"{float(f'{value:.2e}'):.{max(0, 2 - exponent)}f}"
    if not pad and "." in decimal:
        decimal = decimal.rstrip("0").rstrip(".")
    return decimal, exponent if scientific else None


def _body(frame: pd.DataFrame, text: Callable[[Any, bool], Any]) -> list[list[Any]]:
    """Row by row the text of each value. If a number of a column needs all three digits, the others show theirs, too."""
    columns = _columns(frame)
    pads = [any(map(_needs_all, column)) for column in columns]
    return [[text(value, pad) for value, pad in zip(row, pads, strict=True)] for row in zip(*columns, strict=True)]


def _needs_all(value: Any) -> bool:
    if not _is_number(value) or isinstance(value, numbers.Integral) or math.isinf(value):
        return False
    return f"{float(value):.2e}".split("e")[0][-1] != "0"


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not pd.api.types.is_bool(value) and not pd.isna(value)


def _word(value: Any) -> str:
    if pd.api.types.is_bool(value):
        return "yes" if value else "no"
    return MISSING if value is None or (pd.api.types.is_scalar(value) and pd.isna(value)) else numbers_in(str(value))


def _cell(value: Any, pad: bool) -> Cell:
    if _is_number(value):
        return Cell(show(value, pad), repr(float(value)), True)
    return Cell(show(value), "" if show(value) == MISSING else show(value), False)


def _columns(frame: pd.DataFrame) -> list[list[Any]]:
    """The values of each column, as integers if all its numbers are whole. A loop over rows would make floats of integers."""
    columns = []
    for i in range(frame.shape[1]):
        values = list(frame.iloc[:, i].array)
        counts = [_count(value) if _is_number(value) else value for value in values]
        whole = all(isinstance(value, numbers.Integral) for value in counts if _is_number(value))
        columns.append(counts if whole else values)
    return columns


def _sides(frame: pd.DataFrame) -> list[str]:
    columns = [[value for value in column if show(value) != MISSING] for column in _columns(frame)]
    return ["r" if column and all(map(_is_number, column)) else "l" for column in columns]


def _tex_text(text: str) -> str:
    parts = []
    for is_math, run in groupby(SYMBOL.findall(text), key=_is_math):
        translated = "".join(_tex_math(symbol) if is_math else TEX_SPECIAL.get(symbol, symbol) for symbol in run)
        parts.append(f"${translated}$" if is_math else translated)
    return "".join(parts)


def _is_math(symbol: str) -> bool:
    return symbol in TEX_MATH or symbol[0] in POWER or symbol[1:] == BAR


def _tex_math(symbol: str) -> str:
    letter, bar = symbol[0], symbol[1:]
    if letter in POWER:
        return f"{{}}^{{{symbol.translate(LEVEL)}}}"
    return rf"\bar{{{TEX_MATH.get(letter, letter)}}}" if bar else TEX_MATH[letter]
