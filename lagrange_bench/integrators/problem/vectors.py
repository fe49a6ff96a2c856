"""Products of two vectors of three numbers. The numbers may be floats, symbols of formulas, or arrays."""

from collections.abc import Callable
from typing import Any

Vector = tuple[Any, Any, Any]


def cross(a: Any, b: Any) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def cross_in(body: bool) -> Callable[[Any, Any], Vector]:
    """a × b, in the frame of the body b × a: the bracket has the other sign there."""
    return (lambda a, b: cross(b, a)) if body else cross


def dot(a: Any, b: Any) -> Any:
    """a·b."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
