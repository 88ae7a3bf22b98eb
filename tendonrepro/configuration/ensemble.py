"""The ensemble's configuration: box of plausible plants, populations, and what is run on each draw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from pydantic import Field

from tendonrepro.configuration.around import Around
from tendonrepro.configuration.load import (
    ConfigLike,
    Draft,
    LoadedConfig,
    config_digest,
    load_config,
)
from tendonrepro.configuration.models.box import FAST_PERIOD, WORDS, BoxConfig, Confidence
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.readings import VARIATIONS, named_readings
from tendonrepro.configuration.overrides import Override, Overrides, overrides_of
from tendonrepro.configuration.published import COMPARED
from tendonrepro.configuration.quantity import Scalar, positive, whole
from tendonrepro.configuration.strict_model import Identifier, Mistakes, Model, SchemaVersion
from tendonrepro.configuration.strict_yaml import Key, Tree
from tendonrepro.errors import UsageError
from tendonrepro.physics.trajectory import trapezoid_times


class PopulationConfig(Model):
    """Draws in which rows of some confidences vary and the others stay nominal."""

    confidences: Annotated[tuple[Confidence, ...], Field(min_length=1)]
    share: Annotated[Scalar, positive("1", "draws over the number asked for, a power of two", at_most=1.0)]


class EnsembleConfig(Model):
    """Plausible plants under every reading."""

    schema_version: SchemaVersion
    experiment: Literal["ensemble"]
    title: Annotated[str, Field(min_length=1, description="title of tables and files")]
    base: Annotated[str, Field(min_length=1, description="file of the comparison that draws start from")]
    seed: Annotated[Scalar, whole("seed of the draws", at_least=0.0, at_most=2.0**32 - 1.0)]
    scramblings: Annotated[Scalar, whole("independent scramblings", at_least=2.0, at_most=1024.0)]
    block: Annotated[
        Scalar, whole("draws run and stored together, a power of two", at_least=1.0, at_most=65536.0)
    ]
    shortest_run: Annotated[Scalar, positive("s", "periods are repeated until a run lasts this long")]
    longest_run: Annotated[Scalar, positive("s", "no run of the box may last longer")]
    populations: Annotated[dict[Identifier, PopulationConfig], Field(min_length=1)]
    pairs: tuple[Annotated[tuple[str, ...], Field(min_length=1)], ...]
    """settings axis=value that are run together"""
    variations: tuple[str, ...]
    box: BoxConfig

    def _mistakes(self) -> Mistakes:
        powers: dict[Key, Scalar] = {("block",): self.block}
        powers |= {
            ("populations", name, "share"): population.share for name, population in self.populations.items()
        }
        for path, quantity in powers.items():
            if math.frexp(quantity.value)[0] != 0.5:
                yield (*path, "value"), f"must be a power of two, found {quantity}"
        for i, pair in enumerate(self.pairs):
            try:
                named_readings("+".join(pair))
            except UsageError as error:
                yield ("pairs", i), error.message
        known = [variation.name for variation in VARIATIONS]
        for i, name in enumerate(self.variations):
            if name not in known:
                yield ("variations", i), f"must be one of {', '.join(known)}, found {name!r}"
        # Strokes last longest at low speed and large amplitude.
        box = self.box
        _, stroke = trapezoid_times(box.amplitude.highest, box.velocity.lowest, box.acceleration.lowest)
        cycles = dict.fromkeys(WORDS["motion"], box.period.highest) | {
            "minimum_jerk": 2.0 * (box.rise.highest + box.hold.highest),
            "trapezoidal": 2.0 * (stroke + box.hold.highest),
            "fast_sine": FAST_PERIOD,
            "ramp": 2.0 * (box.rise.highest + box.hold.highest),
        }
        # Ramps are a reading as well.
        kind = max((*box.motion.choices, "ramp"), key=lambda kind: cycles[kind])
        longest = max(2.0 * cycles[kind], self.shortest_run.si + cycles[kind])
        if longest > self.longest_run.si:
            covered = f"must cover every motion; {kind} lasts up to {longest:.6g} s"
            yield ("longest_run", "value"), f"{covered}, found {self.longest_run}"


@dataclass(frozen=True)
class LoadedEnsemble:
    """A validated ensemble and where it came from.

    `tree` is what was read, as plain values. `base` is the comparison that draws start from, with the
    overrides and files of both; `sha256` covers it.
    Where draws are `around` its arm, the box says their ranges alone.
    """

    config: EnsembleConfig
    base: LoadedConfig
    tree: Tree
    sha256: str
    origin: str
    around: Around | None = None

    @property
    def compare(self) -> CompareConfig:
        """The base, which `load_ensemble` knows to be a comparison."""
        assert isinstance(self.base.config, CompareConfig)
        return self.base.config


def load_ensemble(
    source: ConfigLike, *, overrides: Overrides | None = (), seed: int | None = None
) -> LoadedEnsemble:
    """Read, complete and validate an ensemble, as `load_config` does.

    Overrides below ``base`` change the comparison.
    """
    changes = overrides_of(overrides, seed)
    return checked_ensemble(Draft(source, "ensemble", changes), changes)


def checked_ensemble(draft: Draft, changes: Sequence[Override]) -> LoadedEnsemble:
    """Validate the draft of an ensemble, and the comparison that it names."""
    config = draft.validate(EnsembleConfig)
    base = load_config(draft.named_file(config.base, "base"), "compare", overrides=draft.for_base)
    if base.config.joints != COMPARED or not set(RUNS) <= set(base.config.runs):
        needed = f"joints {COMPARED} must move, and there must be the runs {', '.join(RUNS)}"
        words = f"{needed}; found {base.config.joints} and {', '.join(base.config.runs)}"
        draft.refuse(("base",), words, "For another arm give --config the file of its comparison.")
    return LoadedEnsemble(
        config=config,
        # What draws and readings decide is no matter of the base.
        base=replace(
            base,
            overrides=tuple(change.text for change in changes),
            inputs=(*draft.files, *base.inputs),
            unread=(),
        ),
        tree=draft.tree,
        sha256=config_digest({"ensemble": config.model_dump(mode="json"), "base": base.sha256}),
        origin=draft.origin,
    )
