"""What a user asks of a command; it loads no heavy library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tendonrepro.errors import UsageError

if TYPE_CHECKING:
    from tendonrepro.configuration.load import ExperimentName, LoadedConfig
    from tendonrepro.configuration.overrides import Overrides


FORMATS = ("pdf", "svg", "png")
"""Formats of figures."""


def formats_of(asked: str | Sequence[str] | None, *, figures: bool = True) -> tuple[str, ...]:
    """Formats to write of every figure: all of `FORMATS` if none are named, none without `figures`.

    Raises
    ------
    UsageError
        For a format that is not there, and for formats of no figures.
    """
    if asked is None:
        return FORMATS if figures else ()
    named = asked.split(",") if isinstance(asked, str) else list(asked)
    for name in named:
        if name not in FORMATS:
            message = f"must be of {', '.join(FORMATS)}, found {name!r}"
            raise UsageError(message, where="--formats", hint="name several as png,pdf")
    if not named or not figures:
        message = "names formats of no figures"
        raise UsageError(
            message, where="--formats", hint="for results without figures say --no-figures alone"
        )
    return tuple(name for name in FORMATS if name in named)


@dataclass(frozen=True)
class Request:
    """Which configuration, changed how, and where results go.

    `config` is a file, ``-`` for standard input, or a shipped name; None is the command's own. `force`
    overwrites results of another configuration. `formats` are those of figures; without any none is drawn.
    """

    config: str | None = None
    out: Path | None = None
    overrides: Overrides = ()
    seed: int | None = None
    controllers: str | Sequence[int] | None = None
    dry_run: bool = False
    force: bool = False
    formats: tuple[str, ...] = FORMATS

    def folder(self, name: str) -> Path:
        """Results folder of the command `name`."""
        return self.out or Path("reports") / name

    def load(self, experiment: ExperimentName) -> LoadedConfig:
        """Read the configuration of an experiment."""
        from tendonrepro.configuration.load import load_config

        return load_config(
            self.config, experiment, overrides=self.overrides, seed=self.seed, controllers=self.controllers
        )
