"""Tests of one group, which share what is long to make, run in one process."""

import pytest


@pytest.mark.xdist_group("kept")
def test_groups_are_kept(request):
    """Fails with pytest 9.2 and pytest-xdist 3.8 (its issue 1386): groups are spread over all processes, silently."""
    if getattr(request.config.option, "loadgroup", False):
        assert request.node.nodeid.endswith("@kept")


def test_a_file_about_integrators_is_a_group(request):
    """As `conftest` makes it: one process compiles its kernels."""
    if getattr(request.config.option, "loadgroup", False):
        files = {item.path.name: item.nodeid for item in request.session.items}
        assert files.get("test_tape.py", "@test_tape").endswith("@test_tape")
