"""Several commands of `lagrange-bench` in one process of their own: starting one takes a second or two."""

import json
import subprocess
import sys

ONE_BY_ONE = """
import contextlib, io, json, sys
from lagrange_bench.__main__ import main

for words in json.loads(sys.argv[1]):
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    said = (stream.buffer.getvalue().decode() for stream in (out, err))
    print(json.dumps((code, *said, sorted({module.partition(".")[0] for module in sys.modules}))))
"""


def one_by_one(commands, folder, environment):
    """Of each command: exit code, stdout, stderr, and the packages that the process has imported so far."""
    words = json.dumps([[str(word) for word in command] for command in commands])
    command = [sys.executable, "-c", ONE_BY_ONE, words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return list(map(json.loads, done.stdout.splitlines()))
