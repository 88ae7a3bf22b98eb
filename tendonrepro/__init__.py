# ruff: noqa: F403, F405
"""Reproduce Yan et al., Actuators 2026, 15(5), 271: tendon decoupling and alpha-TDE-NTSM control.

>>> import tendonrepro as tr
>>> tr.statics().data["joints"]
[1, 2, 3]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tendonrepro.commands import *
    from tendonrepro.studies.result import Result

__version__ = "0.1.0"

__all__ = [
    "Result",
    "__version__",
    "animate",
    "claims",
    "compare",
    "config",
    "decouple",
    "diff",
    "ensemble",
    "explain",
    "export",
    "fetch",
    "figures",
    "identify",
    "ingest",
    "inspect",
    "live",
    "open",
    "predict",
    "recover",
    "report",
    "reproduce",
    "statics",
    "sweep",
    "tables",
    "tune",
    "validate",
]


def __getattr__(name: str) -> Any:
    """Load the interface when it is used: it imports much."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "Result":
        from tendonrepro.studies.result import Result

        return Result
    from tendonrepro import commands

    return getattr(commands, name)


def __dir__() -> list[str]:
    return sorted(__all__)
