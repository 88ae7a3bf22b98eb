"""Reproduce Yan et al., Actuators 2026, 15(5), 271: tendon decoupling and alpha-TDE-NTSM control.

>>> import tendonrepro as tr
>>> tr.statics().data["joints"]
[1, 2, 3]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tendonrepro.api import (
        Result,
        claims,
        compare,
        config,
        decouple,
        ensemble,
        explain,
        open,
        recover,
        statics,
        sweep,
        validate,
    )

__version__ = "0.1.0"

__all__ = [
    "Result",
    "__version__",
    "claims",
    "compare",
    "config",
    "decouple",
    "ensemble",
    "explain",
    "open",
    "recover",
    "statics",
    "sweep",
    "validate",
]


def __getattr__(name: str) -> Any:
    """Load the interface when it is used: it imports much."""
    if name not in __all__:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message)
    from tendonrepro import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted(__all__)
