"""Where machine code is kept on disk; loads nothing that compiles."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from pathlib import Path

import platformdirs


def cache_folder() -> Path:
    """Folder for machine code, not shared, for the code is run; if not writable, one for this process."""
    own = Path(platformdirs.user_cache_dir("tendonrepro")) / "compiled"
    if _is_writable(own):
        return own
    last = Path(tempfile.mkdtemp(prefix="tendonrepro-"))
    atexit.register(shutil.rmtree, last, ignore_errors=True)
    return last


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
