"""Writes files whole or not at all, finds the folder of caches, and reads TOML."""

import errno
import os
import secrets
import stat
import tomllib
from pathlib import Path
from typing import Any


def cache_folder() -> Path | None:
    """The folder of caches; None if the user wants none.

    The variable LAGRANGE_BENCH_CACHE names another folder; if it is empty, there is no cache.
    """
    home = os.environ.get("LAGRANGE_BENCH_CACHE")
    if home is None:
        home = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "lagrange-bench")
    return Path(home) if home else None


def write_file(path: Path, content: str | bytes) -> Path:
    """Write a file beside the old one, then replace it and keep its permissions. The folder is made if there is none.

    OSError if it cannot be written, or is read-only. The error names `path`, and the old file is untouched.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        target = path.resolve()  # the file that a link points to
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, "the file is read-only")
        # `tempfile` makes files that nobody else may read
        temporary = target.with_name(f".{target.name}.{secrets.token_hex(8)}.tmp")
        try:
            with temporary.open("xb") as file:
                if target.exists():
                    temporary.chmod(stat.S_IMODE(target.stat().st_mode))
                file.write(content if isinstance(content, bytes) else content.encode())
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(path)) from error
    return path


def replace_file(path: Path, content: str | bytes) -> str:
    """Write a file that the user named, and return whether an old one was replaced."""
    existed = path.exists()
    write_file(path, content)
    return f"{'replaced' if existed else 'written'}: {path}"


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file. ValueError if it is not TOML; OSError if there is no such file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not TOML: {error}") from None
