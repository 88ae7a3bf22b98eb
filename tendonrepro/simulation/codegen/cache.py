"""Where machine code is kept on disk; loads nothing that compiles.

Each file is named after what it was made from, see `machine`.
"""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import platformdirs


def cache_folder() -> Path:
    """Folder for machine code; made if it is missing.

    Where the user's cache cannot be written, a folder among the temporary files serves all processes, unless
    someone else made it: what lies here is run.
    """
    name = "compiled"
    temporary = Path(tempfile.gettempdir(), f"tendonrepro-{getattr(os, 'getuid', lambda: 0)()}")
    own = Path(platformdirs.user_cache_dir("tendonrepro")) / name
    if _is_writable(own):
        return own
    with suppress(OSError):
        temporary.mkdir(mode=0o700, exist_ok=True)
        if _is_ours(temporary) and _is_writable(temporary / name):
            return temporary / name
    last = Path(tempfile.mkdtemp(prefix="tendonrepro-"))
    atexit.register(shutil.rmtree, last, ignore_errors=True)
    return last


def _is_ours(folder: Path) -> bool:
    """Whether nobody else can put anything into a folder; on Windows temporary files are each user's own."""
    if sys.platform == "win32":
        return True
    held = folder.lstat()
    return stat.S_ISDIR(held.st_mode) and held.st_uid == os.getuid() and not held.st_mode & 0o022


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(2**20))
    except OSError:
        return False
    return True


CACHE = cache_folder()
NOTHING_COMPILED = not any(CACHE.glob("*.o"))
"""Whether there was no code when this process began."""
