# ruff: noqa: F403
"""Reproduce Yan et al., Actuators 2026, 15(5), 271: tendon decoupling and alpha-TDE-NTSM control.

>>> import tendonrepro as tr
>>> tr.statics().data["joints"]
[1, 2, 3]
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tendonrepro.commands import *
    from tendonrepro.studies.result import Result as Result

__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    """Load the interface when it is used: its names are those of `tendonrepro.commands`."""
    commands = import_module("tendonrepro.commands")
    if name == "__all__":
        return ["Result", "__version__", *commands.PUBLIC]
    if name == "Result":
        from tendonrepro.studies.result import Result

        return Result
    if name in commands.PUBLIC:
        return getattr(commands, name)
    from tendonrepro.errors import did_you_mean

    former = commands.FORMER.get(name)
    meant = f", see `tendonrepro {former}`" if former else did_you_mean(name, commands.PUBLIC)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{meant}")


def __dir__() -> list[str]:
    from tendonrepro.commands import PUBLIC

    return sorted(["Result", "__version__", *PUBLIC])
