"""Which experiments there are, and how one is loaded by its name."""

from __future__ import annotations
