"""Files of C and Python that follow a case by themselves: against digits of the named cases, and closed forms of the bench."""

import ctypes
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench import Case
from lagrange_bench.integrators import integrate
from lagrange_bench.integrators.cases.standalone import standalone
from tests.test_integrators.test_rigid_body import free_bodies, heavy_bodies, with_state

COMPILE = ("cc", "-std=c99", "-Wall", "-Werror")
compiled = pytest.mark.skipif(
    shutil.which("cc") is None, reason="no C compiler: the files of case --code c are not tested"
)
both = pytest.mark.parametrize("language", [pytest.param("c", marks=compiled), "python"])
DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def followed(tmp_path):
    """(case, language, times) → q (N, 4), omega (N, 3) and positions (N, 3) from the file."""

    def by_python(text, times):
        names = {"__name__": "a_case"}
        exec(compile(text, "a_case.py", "exec"), names)
        return [(*names["exact"](t), names["position"](t)) for t in times]

    def by_c(text, times):
        (tmp_path / "a_case.c").write_text(text, encoding="utf-8")
        words = (*COMPILE, "-shared", "-fPIC", "-o", "a_case.so", "a_case.c", "-lm")
        subprocess.run(words, cwd=tmp_path, check=True)
        library, rows = ctypes.CDLL(str(tmp_path / "a_case.so")), []
        for t in map(ctypes.c_double, times):
            q, omega, x = ((ctypes.c_double * n)() for n in (4, 3, 3))
            library.exact(t, q, omega)
            library.position(t, x)
            rows.append((list(q), list(omega), list(x)))
        return rows

    def follow(case, language, times):
        text = standalone(case, language, ["a body"])
        assert len(text.splitlines()) <= 200
        rows = {"c": by_c, "python": by_python}[language](text, np.asarray(times).tolist())
        return [np.array(column) for column in zip(*rows, strict=True)]

    return follow


def assert_near(found, q, omega, x):
    q = q * np.sign(np.sum(q * found[0], axis=1))[:, None]
    for numbers, right in zip(found, (q, omega, x), strict=True):
        size = np.max(np.linalg.norm(right, axis=1)) or 1.0
        np.testing.assert_allclose(numbers, right, rtol=0, atol=1e-13 * size)


@both
@pytest.mark.filterwarnings("ignore:inertia_com")
@pytest.mark.parametrize(("body", "state"), [*free_bodies(), *heavy_bodies()])
def test_any_body(body, state, language, followed):
    """Free ones, given by their moments and L, and symmetric ones with a weight; for some 30 rad."""
    body, state = with_state(body, state)
    rate = np.max(np.abs(state[4:] / body.inertia)) + np.sqrt(np.max(np.abs(body.weight)) / np.max(body.inertia))
    start = integrate(body, state, t=[0.0], method="theta_functions")
    case = Case("any", body, start.rotation[0], start.omega_body[0], until=15 / rate)
    run = case.solution(np.linspace(-case.until, case.until, 21))
    q = run.rotation.as_quat(scalar_first=True)
    assert_near(followed(case, language, run.t), q, run.omega_body, run.position)


MINE = """
title = 'no end \\'
mass = 2
inertia_com = [[2, 0.1, 0], [0.1, 3, 0.2], [0, 0.2, 4]]
gravity = [0, 0, 0]
omega_body = [1, 5, -1]
"""


@both
@pytest.mark.parametrize("case", ["slow", "flying_box", "mine.toml"])
def test_a_file_prints_what_its_head_says(case, language, run, folder):
    Path("mine.toml").write_text(MINE, encoding="utf-8")
    assert run("case", case, "--code", language, "--output", "it")[0] == 0
    program = (sys.executable, "it") if language == "python" else ("./program",)
    if language == "c":
        subprocess.run((*COMPILE, "-DCHECK", "-x", "c", "it", "-o", "program", "-lm"), check=True)
    printed = subprocess.run(program, check=True, capture_output=True, text=True).stdout
    for name, size in ("q", 4), ("omega", 3), ("x", 3):
        numbers = rf"{name} = \(?([-+.e\d, ]+)\)?$"
        said, found = (re.search(numbers, text, re.MULTILINE)[1] for text in (Path("it").read_text("utf-8"), printed))
        right, found = (np.array(words.split(", "), dtype=float) for words in (said, found))
        assert len(right) == size
        assert min(np.abs(found - right).max(), np.abs(found + right).max()) <= 1e-12 * np.abs(right).max()


ENGINE = """
void exact(double t, double q[4], double omega[3]);
void my_step(double h, double q[4], double omega[3])
{
    static double t, last;
    t = h == last ? t + h : h, last = h;
    exact(t, q, omega);
    q[0] += ERROR * h * h;
}
"""


@compiled
@pytest.mark.parametrize(("error", "passes"), [("0.01", True), ("0.0001 / h", False)])
def test_the_test_of_the_tutorial(error, passes, run, folder):
    """An engine of second order passes, one of first order fails."""
    page = (DOCS / "tutorials" / "a-test-for-your-engine.md").read_text("utf-8")
    Path("test.c").write_text(re.search(r"^```c\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[1], encoding="utf-8")
    Path("engine.c").write_text(ENGINE, encoding="utf-8")
    assert run("case", "box", "--code", "c", "--output", "box.c")[0] == 0
    subprocess.run((*COMPILE, f"-DERROR={error}", "box.c", "test.c", "engine.c", "-o", "program", "-lm"), check=True)
    done = subprocess.run("./program", capture_output=True, text=True)
    assert ("Assertion" not in done.stderr, done.returncode == 0) == (passes, passes)
