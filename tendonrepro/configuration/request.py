"""What a user asks of a command; it loads no heavy library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tendonrepro.configuration.load import ExperimentName, LoadedConfig


@dataclass(frozen=True)
class Request:
    """Which configuration, changed how, and where results go.

    `config` is a file, ``-`` for standard input, or a shipped name; None is the command's own. `force`
    overwrites results of another configuration.
    """

    config: str | None = None
    out: Path | None = None
    overrides: Sequence[str] = ()
    seed: int | None = None
    controllers: Sequence[int] | None = None
    dry_run: bool = False
    force: bool = False

    def folder(self, name: str) -> Path:
        """Results folder of the command `name`."""
        return self.out or Path("reports") / name

    def load(self, experiment: ExperimentName) -> LoadedConfig:
        """Read the configuration of an experiment."""
        from tendonrepro.configuration.load import load_config

        return load_config(
            self.config, experiment, overrides=self.overrides, seed=self.seed, controllers=self.controllers
        )
