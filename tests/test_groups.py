"""Tests of one group, which share what is long to make, run in one process."""

import pytest


@pytest.mark.xdist_group("kept")
def test_groups_are_kept(request):
    """Fails with pytest 9.2 and pytest-xdist 3.8 (its issue 1386): groups are spread over all processes, silently."""
    if getattr(request.config.option, "loadgroup", False):
        assert request.node.nodeid.endswith("@kept")
