"""`Start`: a problem and the state that a motion starts from, by whatever a user calls them."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from lagrange_bench.integrators.cases import CASES, Case
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import NamedTop
from lagrange_bench.integrators.registry import NAMED_TOPS, find

TOP_TYPES = "a LagrangeTop, a PerturbedTop, a RigidBody or a Problem"


@dataclass(frozen=True, eq=False)
class Start:
    """A problem and the state that a motion starts from.

    Parameters
    ----------
    top : Problem
        What moves.
    state : (n,)
        The initial state, checked.
    flight : (6,), optional
        Position and velocity of the centre of mass of a flying body.
    given_name, given_label : str, optional
        Its names in rows and in titles, where it has any.
    """

    top: Any
    state: Array
    flight: Array | None = None
    given_name: str = ""
    given_label: str = ""

    @classmethod
    def of(cls, thing: Any, y0: ArrayLike | None = None) -> Start:
        """The start that a user means by `thing`.

        Parameters
        ----------
        thing : str, NamedTop, Case, tuple, Problem or Start
            A name: of a named top, a case, one of `examples.PROBLEMS`, a drawn top such as "random000", or "package.module:TOP".
            Or (problem, y0), or (name, problem, y0), or a problem with y0.
        y0 : (n,), optional
            The initial state, in place of its own.

        Returns
        -------
        Start
            With a state that has been checked.

        Raises
        ------
        ValueError
            There is no such name, or it is no problem, or holds many motions; or there is no state, or a wrong one.
        """
        name = thing if isinstance(thing, str) else ""
        problem: Any = _named(name) if name else thing
        label, state = "", y0
        match problem:
            case Start() as start:
                return start
            case NamedTop() as named:
                name, label, problem, state = name or named.name, named.label, named.top, named.state
            case Case() as case:
                name, problem, state = name or case.name, case.body, case.state
            case (Problem(), _):
                problem, state = problem
            case (str(), Problem(), _):
                name, problem, state = problem
        check_problem(problem).require_single()
        if state is None:
            raise ValueError(
                "y0: give the initial state; named tops and cases, such as 'generic' and 'bruels', have their own"
            )
        state, flight = split_state(problem, state if y0 is None else y0)
        return cls(problem, problem.check_state(state), flight, name, label)

    @classmethod
    def each_of(cls, things: Any) -> tuple[Start, ...]:
        """The starts of one thing or of several, as for `of`; ValueError names the argument `tops`."""
        is_pair = isinstance(things, tuple) and any(isinstance(part, Problem) for part in things[-2:-1])
        if isinstance(things, (str, NamedTop, Case, Problem)) or is_pair:
            things = [things]
        if not isinstance(things, Iterable):
            raise ValueError(f"tops must be names, or pairs of a problem and a state; got {things!r}")
        try:
            return tuple(map(cls.of, things))
        except ValueError as error:
            raise ValueError(f"tops: {error}") from None

    @property
    def name(self) -> str:
        """Its name in rows."""
        problem = getattr(self.top, "name", "") or textwrap.shorten(repr(self.top), 60, placeholder=" …")
        return self.given_name or str(problem)

    @property
    def label(self) -> str:
        """Its name in titles."""
        return self.given_label or self.name

    @property
    def unit(self) -> float:
        """The time scale of the motion, in the problem's own unit of time."""
        return float(self.top.scales(self.state)[2])


def split_state(problem: Any, y: Any) -> tuple[Any, Array | None]:
    """A state, and for a flying body its position and velocity (6,), otherwise None."""
    return problem.split_state(y) if kinds.rigid_body(problem) else (y, None)


def check_problem(top: Any) -> Any:
    """`top` itself; ValueError if it is no problem."""
    if not isinstance(top, Problem):
        hint = ": pass its problem()" if callable(getattr(top, "problem", None)) else ""
        raise ValueError(f"top must be {TOP_TYPES}; got {type(top).__name__}{hint}")
    return top


def is_taken(name: str) -> bool:
    """Whether the bench has a top of this name."""
    from lagrange_bench.integrators.problem.examples import is_drawn

    return name in NAMED_TOPS or is_drawn(name)


def _named(name: str) -> Any:
    """The NamedTop, Case or pair of a name; ValueError if there is none."""
    if name in NAMED_TOPS:
        return NAMED_TOPS[name]
    if name in CASES:
        return CASES[name]
    from lagrange_bench.integrators.problem import examples

    if name in examples.PROBLEMS:
        return examples.problem(name)
    return examples.drawn_top(name) if examples.is_drawn(name) else find(name, NAMED_TOPS)
