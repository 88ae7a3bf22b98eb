"""What the processes that integrate and draw import once, see :func:`tendonrepro.parallel.prepare`."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from importlib import import_module

MODULES = (
    "tendonrepro.cli.app",
    "tendonrepro.simulation.single",
    "tendonrepro.results.figures.catalogue",
    "scipy.integrate",
)
_PR_SET_PDEATHSIG = 1

# Ends with the command, even where it hangs in an import, as some libraries do for want of memory.
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
# Where the system refuses, here or when the server forks, the command that asked for it says so.
sys.excepthook = lambda *_: None
try:
    for _name in MODULES:
        import_module(_name)
except (OSError, MemoryError):
    os._exit(1)
