"""The command line as it is used: in a terminal, with a keyboard. A pseudo-terminal of the standard library is enough."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from faults import squares

from lagrange_bench.results.store import Store, make_record

pty = pytest.importorskip("pty", reason="no pseudo-terminals on this platform")
pytestmark = pytest.mark.processes
HERE = Path(__file__).resolve().parents[1]  # the tests, where toys are
PATIENCE = 60.0  # s; it takes two
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal:
    """A process whose stdin, stdout and stderr are one terminal; what it shows is collected."""

    def __init__(self, words, width=100, **environment):
        import fcntl
        import struct
        import termios

        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 30, width, 0, 0))
        inherited = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "COLUMNS", "LINES", "FORCE_COLOR")}
        settings = {**inherited, "TERM": "xterm-256color", "PYTHONPATH": str(HERE), **environment}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "lagrange_bench", *map(str, words)], cwd=HERE.parent, env=settings, close_fds=True,
            stdin=slave, stdout=slave, stderr=slave, start_new_session=True, preexec_fn=lambda: _control(slave),
        )  # fmt: skip
        os.close(slave)
        self.shown = ""

    def read(self, until=None):
        """Reads until the pattern is shown, or to the end."""
        end = time.monotonic() + PATIENCE
        while until is None or not re.search(until, ESCAPES.sub("", self.shown)):
            assert time.monotonic() < end, f"not in time: {until}; shown: {self.shown!r}"
            if not select.select([self.master], [], [], 0.2)[0]:
                continue
            try:
                piece = os.read(self.master, 65536)
            except OSError:  # on Linux: nobody holds the other end any more
                piece = b""
            if not piece:
                assert until is None, f"ended without {until}: {self.shown!r}"
                break
            self.shown += piece.decode("utf-8", "replace")
        return ESCAPES.sub("", self.shown)

    def end(self):
        """What was shown in all, and the exit code."""
        return self.read(), self.process.wait(PATIENCE)


def _control(slave):
    """The terminal becomes the one whose Ctrl-C reaches the process."""
    import fcntl
    import termios

    fcntl.ioctl(slave, termios.TIOCSCTTY, 0)


@pytest.fixture
def terminal(tmp_path):
    opened = []

    def call(cells, *words, **settings):
        line = ("run", "toys.behaviour", "--results", tmp_path / "r", "--jobs", "2", *words)
        opened.append(Terminal(line, TOY_CELLS=json.dumps(cells), **settings))
        return opened[-1]

    yield call
    for one in opened:
        if one.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(one.process.pid, signal.SIGKILL)
            one.process.wait()
        os.close(one.master)


def test_progress_interrupt_and_resume(terminal, tmp_path):
    gate = tmp_path / "gate"  # the last cell waits for it
    cells = [*squares(0, 1), {"do": "raise", "i": 2}, {"do": "wait for lines", "i": 3, "file": str(gate), "lines": 1}]
    first = terminal(cells)
    first.read(r"toys\.behaviour.* 3/4 1 failed ")  # it is shown while the last one runs
    os.write(first.master, b"\x03")  # Ctrl-C, typed
    shown, code = first.end()
    assert code == 130
    message = f"interrupted: 2 of 4 cells are stored in {tmp_path / 'r'}; run the same command again to resume"
    assert message in " ".join(shown.split())  # without the line breaks at the right edge
    assert "Traceback" not in shown
    gate.write_text("open\n")
    shown, code = terminal(cells, width=120).end()
    assert code == 1
    assert re.search(r"toys\.behaviour .* 2/2 1 failed", shown)
    assert re.search(r"toys\.behaviour +4 +1 +2 ", shown)  # cells, computed, stored before
    assert "again, the failed cells only: lagrange-bench run toys.behaviour --results" in " ".join(shown.split())


def test_no_bars_for_a_dumb_terminal_or_in_quiet(terminal):
    dumb = terminal(squares(0, 1), TERM="dumb")
    shown, code = dumb.end()
    assert (code, "\x1b[" in dumb.shown, "toys.behaviour: 2/2 cells" in shown) == (0, False, True)
    shown, code = terminal(squares(0, 1, 2), "--quiet").end()
    assert (code, "1/1" in shown) == (0, False)


def test_a_page_in_the_making_is_given_up_at_once(tmp_path):
    """Each of four experiments takes a minute to draw; the bar is shown, and Ctrl-C ends the drawing processes too."""
    names = ("one", "two", "three", "four")
    for name in names:
        folder = tmp_path / "slow"
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.py").write_text(
            "import os, time\nVERSION = 1\n"
            "def cells(profile): return []\ndef measure(cell): return []\ndef tables(rows): return {}\n"
            f"def draw(rows):\n    open({str(tmp_path / 'drawing')!r}, 'a').write(f'{{os.getpid()}} ')\n    time.sleep(60)\n"
        )
        outcome = {"status": "done", "rows": [{"x": 1.0}], "error": None, "warnings": [], "seconds": 0.1}
        Store(tmp_path).append(make_record(f"slow.{name}", 1, 0, {"i": 0}, **outcome))
    own = [word for name in names for word in ("--module", f"slow.{name}")]
    words = ("report", "--results", tmp_path, "--output", tmp_path / "page", *own)
    one = Terminal(words, PYTHONPATH=f"{tmp_path}{os.pathsep}{HERE}")
    try:
        one.read(r"drawing .* \d+/\d+")
        while not (tmp_path / "drawing").exists():
            assert one.process.poll() is None, one.shown
            time.sleep(0.05)
        begun = time.monotonic()
        os.write(one.master, b"\x03")
        shown, code = one.end()
    finally:
        if one.process.poll() is None:
            os.killpg(one.process.pid, signal.SIGKILL)
        os.close(one.master)
    assert code == 130
    assert time.monotonic() - begun < 30, "it waited for the drawings"
    assert "Traceback" not in shown
    assert not (tmp_path / "page" / "index.html").exists()
    for pid in (tmp_path / "drawing").read_text().split():
        with pytest.raises(ProcessLookupError):
            os.kill(int(pid), 0)
