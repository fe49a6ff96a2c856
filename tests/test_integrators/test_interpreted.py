"""The first calls of a kernel are interpreted: the same bits, and the seconds that its compilation takes come later."""

import os
import subprocess
import sys

import numpy as np
import pytest

from lagrange_bench.integrators.compiling import interpreted
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted

OFTEN = 10

pytestmark = pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")

# last states of runs that begin one after the other, and which of them found the set-up compiled
RUNS = """
from lagrange_bench.integrators import PERTURBED_TOPS, TOPS, integrate
from lagrange_bench.integrators.compiling.interpreted import OFTEN
from lagrange_bench.integrators.methods import backlund
for named, method in ((TOPS["generic"], "backlund"), (PERTURBED_TOPS["weak_tide"], "backlund_splitting")):
    h = 20.0 if method == "backlund" else 0.1
    ends = [integrate(named.top, named.y0, h, 20, method).y[-1].tobytes().hex()]
    print(method, bool(backlund.run.overloads), bool(backlund.exact_constants.overloads))
    ends += [integrate(named.top, named.y0, h, 20, method).y[-1].tobytes().hex() for _ in range(OFTEN)]
    print(ends[0], len(set(ends)), bool(backlund.run.overloads))
"""


def test_the_first_run_waits_for_no_set_up_to_compile_and_has_the_same_bits(tmp_path):
    def run(**settings):
        environment = {**os.environ, "LAGRANGE_BENCH_CACHE": str(tmp_path), **settings}
        done = subprocess.run(
            [sys.executable, "-c", RUNS], env=environment, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return [line.split() for line in done.stdout.splitlines()]

    first, second = run(), run()
    assert first[0][1:] == ["False", "False"]
    assert first[1][1:] == first[3][1:] == ["1", "True"]
    assert second[0][1] == "True"  # out of the cache, from the first call on
    assert [first[1], first[3]] == [second[1], second[3]]


@pytest.fixture(autouse=True)
def as_in_a_new_process(monkeypatch):
    """Whatever the tests before have imported: what measures times has everything compiled at once."""
    monkeypatch.setattr(interpreted, "OFTEN", OFTEN)


def test_a_kernel_is_compiled_from_the_call_on_that_its_docstring_says():
    kernel = compiled(lambda a: a[0] + 1.0)
    call = at_first_interpreted(kernel)
    for k in range(interpreted.OFTEN + 1):
        assert not kernel.overloads
        assert call(np.full(3, k)) == k + 1.0
    assert kernel.overloads

    large = compiled(lambda a: a[0] + 1.0)
    at_first_interpreted(large)(np.zeros(interpreted.MANY + 1))
    assert large.overloads


def test_where_python_raises_compiled_code_begins_anew():
    """And finds its arrays as they were."""

    @compiled
    def divided(a, x):
        a[0] += 1.0
        a[0] += 1.0 / x
        return 2.0 * a[0]

    call, a = at_first_interpreted(divided), np.zeros(1)
    assert (call(a, 0.5), a[0], len(divided.overloads)) == (6.0, 3.0, 0)
    assert (call(a, 0.0), a[0], len(divided.overloads)) == (np.inf, np.inf, 1)
