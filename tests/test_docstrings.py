"""Docstrings of what a user calls say all parameters and what comes back, in numpydoc's form; `numpydoc` checks it."""

import inspect

import pytest

import lagrange_bench

# no docstring; parameters that are missing, unknown, without a type or a description; no description of what is returned
ASKED = {"GL08", "PR01", "PR02", "PR04", "PR07", "PR10", "RT01", "RT03"}
BRIEF = ("sin", "cos", "exp", "log", "Stepper")  # the first four as `sqrt`; a protocol has no parameters of its own
RESULTS = ("Trajectory", "EnsembleTrajectory", "Comparison")  # what a user gets: their methods count, too


def functions():
    for name in lagrange_bench.__all__:
        item = getattr(lagrange_bench, name)
        if callable(item) and name not in BRIEF:
            yield f"{item.__module__}.{item.__qualname__}"
        if name in RESULTS:
            words = (word for word, _ in inspect.getmembers(item, inspect.isfunction) if word[0] != "_")
            yield from (f"{item.__module__}.{name}.{word}" for word in words)


def test_docstrings_say_parameters_and_results():
    # with Sphinx: collecting the tests does not wait for it; with the oldest packages it is not there
    validate = pytest.importorskip("numpydoc.validate").validate

    errors = {name: [text for code, text in validate(name)["errors"] if code in ASKED] for name in functions()}
    assert len(errors) > 50
    assert {name: texts for name, texts in errors.items() if texts} == {}
