"""The pytest plug-in: bounds on the drift of your methods, kept in a file beside the tests.

    def test_drift(drift_bounds):
        drift_bounds(METHOD, tops=("generic", "fast"), h=0.1, steps=10**6)

`pytest --write-drift-bounds` measures and writes the file, every other run tests against it. Outside the package
`lagrange_bench`, and importing it late: every pytest run loads this module, also where another folder hides a package of the
bench.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

FILE = "drift-bounds.toml"


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("lagrange-bench")
    text = f"bounds that the fixture drift_bounds tests against (default: {FILE} in the root folder of the tests)"
    group.addoption("--drift-bounds", metavar="FILE", help=text)
    text = "measure, and write twice what was found into the file of bounds; not with pytest-xdist's -n"
    group.addoption("--write-drift-bounds", action="store_true", help=text)


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("write_drift_bounds") and getattr(config.option, "numprocesses", None):
        raise pytest.UsageError("--write-drift-bounds: processes would overwrite each other's bounds: leave out -n")


@pytest.fixture
def drift_bounds(request: pytest.FixtureRequest) -> Callable[..., None]:
    """drift_bounds(METHOD, tops=…, h=…, steps=…, options=…) fails if an invariant drifts beyond its bound in the file."""
    import lagrange_bench  # noqa: F401, which names a folder that hides a package of the bench
    from lagrange_bench.experiments.measuring import bounds
    from lagrange_bench.integrators.registry import find_method

    config = request.config
    chosen = config.getoption("drift_bounds")
    path = config.rootpath / FILE if chosen is None else config.invocation_params.dir / chosen

    def test(method: Any, *, options: Any = None, **runs: Any) -> None:
        __tracebackhide__ = True
        found = find_method(method)
        wanted = bounds.plan(found, **runs)
        if config.getoption("write_drift_bounds"):
            bounds.write_bounds(path, bounds.measured(found, wanted, options))
            return
        known = {bounds.run_of(bound): bound for bound in bounds.read_bounds(path)} if path.exists() else {}
        if missing := [bound for bound in wanted if bounds.run_of(bound) not in known]:
            first = ", ".join(f"{key} = {value}" for key, value in missing[0].items())
            pytest.fail(f"{path} has no bound for {first}: write it with pytest --write-drift-bounds", pytrace=False)
        verdicts = list(bounds.judge(found, [known[bounds.run_of(bound)] for bound in wanted], options))
        if wrong := [f"{found.name}: {verdict}" for verdict in verdicts if not verdict.passed]:
            pytest.fail("\n".join(wrong), pytrace=False)

    return test
