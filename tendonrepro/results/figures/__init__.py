"""Figures drawn from traces, of which `catalogue` knows which there are; and the formats of all figures."""

from __future__ import annotations

from collections.abc import Sequence

from tendonrepro.errors import UsageError

FORMATS = ("png", "pdf", "svg")
"""Formats of figures."""
DRAWN = ("png", "pdf")
"""Those that are drawn where none are named."""


def formats_of(asked: str | Sequence[str] | None, *, figures: bool = True) -> tuple[str, ...]:
    """Formats to write of every figure: `DRAWN` if none are named, none without `figures`.

    Raises
    ------
    UsageError
        For a format that is not there, and for formats of no figures.
    """
    if asked is None:
        return DRAWN if figures else ()
    named = asked.split(",") if isinstance(asked, str) else list(asked)
    for name in named:
        if name not in FORMATS:
            message = f"must be one of {', '.join(FORMATS)}, found {name!r}"
            raise UsageError(message, where="--formats", hint="name several as png,pdf")
    if not named or not figures:
        message = "names formats of no figures"
        raise UsageError(
            message, where="--formats", hint="for results without figures say --no-figures alone"
        )
    return tuple(name for name in FORMATS if name in named)
