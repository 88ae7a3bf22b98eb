"""What the processes that integrate and draw import once, see :func:`tendonrepro.parallel.prepare`."""

from __future__ import annotations

import os
from importlib import import_module

MODULES = (
    "tendonrepro.cli.app",
    "tendonrepro.simulation.codegen.compiled",
    "tendonrepro.results.figures.catalogue",
    "scipy.integrate",
)

try:
    for _name in MODULES:
        import_module(_name)
except (OSError, MemoryError):
    # The command that meets the same refusal says so in a sentence.
    os._exit(1)
