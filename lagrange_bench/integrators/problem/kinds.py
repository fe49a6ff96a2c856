"""Predicates that a `Method` may need beside the words of `interface.NEEDS`; their docstrings say what they ask for."""

from typing import Any


def top(problem: Any) -> bool:
    """a Hamiltonian |J|²/2 + U(x)"""
    return driven_top(problem) and not problem.timed


def driven_top(problem: Any) -> bool:
    """a Hamiltonian |J|²/2 + U(t, x)"""
    return getattr(problem, "is_top", False)


def quadratic_top(problem: Any) -> bool:
    """a Hamiltonian |J|²/2 + U(x) with a quadratic U"""
    return top(problem) and problem.quadratic


def uniform(problem: Any) -> bool:
    """a LagrangeTop, in a uniform field"""
    return "uniform" in getattr(problem, "offers", ())


def rigid_body(problem: Any) -> bool:
    """a RigidBody"""
    return "body" in getattr(problem, "offers", ())


def symmetric_body(problem: Any) -> bool:
    """a symmetric RigidBody"""
    return rigid_body(problem) and problem.symmetry is not None


def free_body(problem: Any) -> bool:
    """a RigidBody without torque"""
    return rigid_body(problem) and problem.is_free
