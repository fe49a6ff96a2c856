"""How the differences between stored cells are printed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from lagrange_bench.text import table

MOST = 10  # cells listed of a kind


def listed(experiment: str, what: str, cells: Sequence[dict[str, Any]], most: int | None = MOST) -> list[str]:
    lines = [f"{what}: {experiment} {json.dumps(cell, ensure_ascii=False)}" for cell in cells[:most]]
    return lines + ([f"… and {len(cells) - len(lines)} more {what} in {experiment}"] if len(cells) > len(lines) else [])


def changed_columns(experiment: str, changed: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> list[str]:
    """By how much, column by column; then the first few cells."""
    if not changed:
        return []
    rows: list[tuple[str, ...]] = [("column", "cells", "rows", "largest difference", "relative", "old", "new")]
    for column in dict.fromkeys(name for _, differing in changed for name in differing):
        found = [differing[column] for _, differing in changed if column in differing]
        worst = max(found, key=lambda difference: difference.relative)
        sizes = (f"{max(difference.absolute for difference in found):.1e}", f"{worst.relative:.1e}")
        counts = (str(len(found)), str(sum(difference.rows for difference in found)))
        rows.append((column, *counts, *sizes, _short(worst.old), _short(worst.new)))
    return [
        "",
        f"changed in {experiment}:",
        *table(rows),
        *listed(experiment, "changed", [cell for cell, _ in changed]),
    ]


def as_data(cell: dict[str, Any], differing: dict[str, Any]) -> dict[str, Any]:
    return {"cell": cell, "columns": {column: asdict(difference) for column, difference in differing.items()}}


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"
