"""What is asked of the paper's experiments, and the experiments that are ready to run."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from tendonrepro.configuration.command import checked
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import ExperimentName, LoadedConfig, Source, load_config
from tendonrepro.configuration.overrides import Overrides
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.run import Prepared, prepared
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.results.formats import formats_of
from tendonrepro.studies.parameters import FOLDER, Folder

CLOSEST = "closest"
"""Name of the shipped configuration that was fitted to Tables 2 and 3."""


@dataclass(frozen=True)
class Order:
    """One of the paper's experiments as a user wants it; `folder` says where its results go."""

    experiment: ExperimentName
    config: Source = None
    changes: Overrides | None = None
    seed: int | None = None
    controllers: str | Sequence[int] | None = None
    laws: Sequence[UserLaw] = ()
    solver: Literal["scipy", "compiled"] = "scipy"
    folder: Folder = field(default_factory=Folder)

    @property
    def name(self) -> str:
        """What its results are called."""
        return CLOSEST if self.config == CLOSEST else self.experiment

    @property
    def options(self) -> Folder:
        """All of its folder, with what holds where nothing was said."""
        return {**FOLDER, **self.folder}

    @property
    def out(self) -> Path:
        """Results folder."""
        out = self.options["out"]
        return Path("reports") / self.experiment if out is None else Path(out)

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats of its figures."""
        return formats_of(self.options["formats"], figures=self.options["figures"])

    def load(self) -> LoadedConfig:
        """Read its configuration."""
        return load_config(
            self.config,
            self.experiment,
            overrides=self.changes,
            seed=self.seed,
            controllers=self.controllers,
        )

    def prepared(self, talk: Talk) -> Prepared:
        """Configuration, laws and loops; the digest covers stepper and laws."""
        if self.solver == "compiled" and self.laws:
            message = "only the paper's own control laws run on lanes"
            raise UsageError(message, where="--law", hint="use the SciPy stepper, --solver scipy")
        loaded = self.load()
        remark(loaded, talk)
        if self.solver == "compiled":
            digest = hashlib.sha256(f"{loaded.sha256} compiled".encode()).hexdigest()
            loaded = replace(loaded, sha256=digest, overrides=(*loaded.overrides, "solver=compiled"))
        return prepared(loaded, self.laws)


def paper_orders(
    configs: Path | None, changes: Overrides | None, seed: int | None, folder: Folder
) -> list[Order]:
    """Orders for both experiments of the paper, and for the comparison fitted to its tables.

    `configs` is a folder with ``decouple.yaml`` and ``compare.yaml``. The fitted plant runs only as it is
    shipped. The folder is the one above theirs.
    """
    names: tuple[ExperimentName, ...] = ("decouple", "compare")
    above = Path(folder.get("out") or "reports")
    files = {name: None if configs is None else str(configs / f"{name}.yaml") for name in names}
    orders = [
        Order(name, files[name], changes, seed, folder={**folder, "out": above / name}) for name in names
    ]
    if configs is None and not changes and seed is None:
        orders.append(Order("compare", CLOSEST, folder={**folder, "out": above / CLOSEST}))
    return orders


def check(config: str, overrides: Overrides, talk: Talk) -> dict[str, Any]:
    """Kind, digest and runs of a configuration, checked as running it would."""
    held = checked(config, overrides)
    found = {"schema_version": 1, "config": config}
    if isinstance(held, LoadedEnsemble):
        return found | {"kind": "ensemble", "config_sha256": held.sha256}
    if not isinstance(held, LoadedConfig):
        return found | {"kind": "manipulator"}
    remark(held, talk)
    runs = list(all_loops(held))
    return found | {"kind": held.config.experiment, "config_sha256": held.sha256, "runs": runs}


def remark(loaded: LoadedConfig, talk: Talk) -> None:
    """Name shipped files that stand in for files that are not there, and keys that change nothing."""
    for sentence in loaded.unread:
        talk.note(sentence)
    for path in loaded.stand_ins:
        talk.note(f"no {path.name} in {loaded.folder}, so the shipped one is taken: {path}")
