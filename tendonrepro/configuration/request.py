"""What a user asks of a command that runs something: the same for all of them.

It loads no heavy library, since every command line begins with it.
"""

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

    Attributes
    ----------
    config : str or None
        File, ``-`` for standard input, or a shipped name; None is the shipped configuration of the command.
    out : Path or None
        Results folder; None is the command's own under ``reports``.
    overrides : sequence of str
        ``dotted.key=VALUE``.
    seed : int or None
        Replaces the configuration's.
    controllers : sequence of int or None
        Numbers of the controllers to run; None is all.
    dry_run, force : bool
        Check everything but run nothing; overwrite results of another configuration or version.
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
        """Read the configuration of an experiment; see :func:`tendonrepro.configuration.load.load_config`."""
        from tendonrepro.configuration.load import load_config

        return load_config(
            self.config, experiment, overrides=self.overrides, seed=self.seed, controllers=self.controllers
        )
