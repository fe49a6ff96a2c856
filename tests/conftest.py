"""heyoka keeps compiled code on disk; the tests use a folder of their own, not the user's."""

import os
import tempfile

_folder = tempfile.TemporaryDirectory(prefix="heyoka-")
os.environ["HEYOKA_CACHE_DIR"] = _folder.name
