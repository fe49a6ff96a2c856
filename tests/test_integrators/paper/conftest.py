"""Random points at which identities of the paper are tested."""

import pytest

from tests.test_integrators.paper.tools import at_point


@pytest.fixture(params=[(15, 0), (15, 1), (50, 4), (50, 5)], ids="{0[0]}-{0[1]}".format)
def p(request):
    """A point in double or in 50 digits; even seeds are on sheet 1, odd ones on sheet −1."""
    yield from at_point(*request.param)


@pytest.fixture(params=[6, 7])
def fine(request):
    """A point in 50 digits, for derivatives by differences."""
    yield from at_point(50, request.param)
