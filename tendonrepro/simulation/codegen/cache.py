"""Where compiled code is kept on disk; loads nothing that compiles.

The folder is named after a hash of all sources that may be compiled, because numba itself would not notice a
change in a function of another module.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from itertools import chain
from pathlib import Path

import platformdirs


def sources() -> list[Path]:
    """Files whose functions are compiled, and those that write what is compiled."""
    package = Path(__file__).parents[2]
    rooms = (sorted((package / room).rglob("*.py")) for room in ("physics", "simulation"))
    return [package / "arrays.py", *chain.from_iterable(rooms)]


def cache_folder() -> Path:
    """Folder for compiled code of exactly these sources; made if it is missing.

    Where the user's cache cannot be written, a folder among the temporary files serves all processes, unless
    someone else made it: what lies here is run.
    """
    digest = hashlib.sha256()
    for source in sources():
        digest.update(source.read_bytes())
    name = Path("compiled", digest.hexdigest()[:16])
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


def _drop_broken(folder: Path) -> None:
    """Remove code that a power cut left cut short: numba would stop at it, each time anew."""
    for path in (*folder.glob("**/*.nbi"), *folder.glob("**/*.nbc")):
        with suppress(OSError):
            if path.read_bytes()[-1:] != pickle.STOP:
                path.unlink()


CACHE = cache_folder()
_drop_broken(CACHE)
NOTHING_COMPILED = not any(CACHE.glob("**/*.nbc"))
"""Whether there was no code for this machine and these sources when this process began."""
