"""Plants to draw: an ensemble with its box, or a spread and ranges around an arm of one's own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, ValidationError

from tendonrepro.configuration import load, strict_yaml
from tendonrepro.configuration.load import ConfigLike, Draft, LoadedConfig, load_config
from tendonrepro.configuration.models.box import FAST_PERIOD, PER_JOINT, SHARED, WORDS, BoxConfig, Confidence
from tendonrepro.configuration.models.control import PRINTED_LAWS, RUNS
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.readings import VARIATIONS, Reading, named_readings, under
from tendonrepro.configuration.overrides import Override, Overrides, overrides_of
from tendonrepro.configuration.published import COMPARED
from tendonrepro.configuration.quantity import Ends, Scalar, positive, whole
from tendonrepro.configuration.rows import held_values
from tendonrepro.configuration.strict_model import Identifier, Mistakes, Model, SchemaVersion, explain
from tendonrepro.configuration.strict_yaml import Node, Tree
from tendonrepro.errors import ConfigError, UsageError, did_you_mean
from tendonrepro.physics.trajectory import trapezoid_times

_HELD = ("link_static_ratio", "winch_static_ratio", "winch_stribeck_velocity", "reducer_efficiency")
_HELD_DRIVES = ("torque_resolution", "torque_noise")
ROWS: Mapping[str, str] = {
    row.key: name for name, row in {**PER_JOINT, **SHARED}.items() if name not in _HELD + _HELD_DRIVES
}
"""Rows of the box that vary around an arm, by the arm's keys; what an arm has off stays off."""

_OF = {"friction.link.stribeck_velocity": "friction.link.coulomb"}
"""Keys that are of an effect whose size is another one."""

MOST = 10.0
"""Largest factor on a value of an arm, and its inverse the smallest."""

Ranges: TypeAlias = Sequence[str] | Mapping[str, Sequence[float]] | None
"""``KEY=LOW,HIGH``, or ends by key, as a user gives them."""


@dataclass(frozen=True)
class Around:
    """Draws around an arm of one's own.

    Its values are multiplied by factors. Those of a key in `ranges` lie between its ends, the others between
    1 + `spread` and its inverse; where that is None the shipped ranges over their nominal values hold.
    """

    arm: str
    spread: float | None = None
    ranges: Mapping[str, Ends] = field(default_factory=dict)

    @property
    def told(self) -> str:
        """In words, for tables and pictures: these are the user's ranges, not those of the paper's arm."""
        if self.spread is None:
            others = f"around {self.arm}, the shipped ranges relative to its values"
        else:
            others = f"around {self.arm}, each value within a factor of {1.0 + self.spread:g}"
        own = [
            f"{key} times {low:g} to {high:g}" if low < high else f"{key} times {low:g}"
            for key, (low, high) in self.ranges.items()
        ]
        return "; ".join([others, *own])

    def as_data(self) -> dict[str, object]:
        """Plain values for JSON."""
        ranges = {"ranges": {key: [*ends] for key, ends in self.ranges.items()}} if self.ranges else {}
        return {"arm": self.arm, "spread": self.spread, **ranges}


class PopulationConfig(Model):
    """Draws in which rows of some confidences vary and the others stay nominal."""

    confidences: Annotated[tuple[Confidence, ...], Field(min_length=1)]
    share: Annotated[Scalar, positive("1", "draws over the number asked for: 1", at_most=1.0)]


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
        if math.frexp(self.block.value)[0] != 0.5:
            yield ("block", "value"), f"must be a power of two, found {self.block}"
        if [population.share.value for population in self.populations.values()] != [1.0]:
            told = "must be one, with a share of 1; run each other one into an --out of its own"
            yield ("populations",), told
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
        ramp = 2.0 * (box.rise.highest + box.hold.highest)
        cycles = dict.fromkeys(WORDS["motion"], box.period.highest) | {
            "minimum_jerk": ramp,
            "trapezoidal": 2.0 * (stroke + box.hold.highest),
            "fast_sine": FAST_PERIOD,
        }
        # Ramps are a reading, which is there whatever the choices.
        cycle = max(ramp, *(cycles[kind] for kind in box.motion.choices))
        longest = max(2.0 * cycle, self.shortest_run.si + cycle)
        if longest > self.longest_run.si:
            covered = f"must cover every motion; one lasts up to {longest:.6g} s"
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
    def remarks(self) -> tuple[str, ...]:
        """Of the base."""
        return self.base.remarks

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
            remarks=(),
        ),
        tree=draft.tree,
        sha256=load.config_digest({"ensemble": config.model_dump(mode="json"), "base": base.sha256}),
        origin=draft.origin,
    )


def _ranges_on(config: CompareConfig, ranges: Ranges) -> dict[str, Ends]:
    """Ends of the factors on the values of keys that vary, once each, and act on the arm."""
    checked: dict[str, Ends] = {}
    for key, ends in ranges.items() if isinstance(ranges, Mapping) else map(_read, ranges or ()):
        owner = _OF.get(key, key)
        if key not in ROWS:
            wrong = f"no key {key!r} varies around an arm{did_you_mean(key, ROWS)}"
            hint = f"There are: {', '.join(ROWS)}"
        elif key in checked:
            wrong, hint = f"{key} is given twice", "name each key once"
        elif len(ends) != 2 or not 1.0 / MOST <= ends[0] <= ends[1] <= MOST:
            factors = f"two factors from {1.0 / MOST:g} to {MOST:g}, the smaller first"
            wrong = f"{key}: needs {factors}, found {','.join(f'{end:g}' for end in ends)}"
            hint = f"{key}=0.5,2 is half to twice the arm's value"
        elif not np.any(held_values(config.manipulator, owner)[-len(config.joints) :]):
            wrong = f"{owner} is 0 on {config.manipulator.name}, so nothing depends on {key}"
            hint = f"give the arm a {owner} above 0, or leave this range out"
        else:
            checked[key] = (float(ends[0]), float(ends[1]))
            continue
        raise UsageError(wrong, where="--range", hint=hint)
    return checked


def _read(text: str) -> tuple[str, list[float]]:
    """Key and numbers of ``KEY=LOW,HIGH``; one number stands for both."""
    key, _, ends = text.partition("=")
    try:
        numbers = [float(end) for end in ends.strip("[]").split(",")]
    except ValueError:
        message = f"must be KEY=LOW,HIGH, found {text!r}"
        raise UsageError(message, where="--range", hint="For example --range links.mass=0.5,2") from None
    return key.strip(), numbers * 2 if len(numbers) == 1 else numbers


def drawn_config(tree: Mapping[str, Node], around: Around) -> CompareConfig:
    """Comparison with a drawn arm; a ConfigError where a value left what is possible."""
    try:
        return CompareConfig.model_validate(tree)
    except ValidationError as error:
        first = explain(error, tree, around.arm).message.splitlines()[1]
        message = f"an arm drawn {around.told}, is impossible: {first.partition(': ')[2]}"
        hint = "give a smaller --spread, or --range KEY=LOW,HIGH for that key"
        raise ConfigError(message, hint=hint) from error


_DRAWING = {("hardware", "drawn"), ("motion", "ramp"), ("starts", "apart"), ("run_friction", "drawn")}
"""Settings of readings whose numbers are rows of the box."""


def load_plants(
    source: ConfigLike,
    spread: float | None = None,
    ranges: Ranges = None,
    overrides: Overrides | None = None,
    seed: int | None = None,
) -> LoadedEnsemble:
    """Read an ensemble as it is, or a comparison, around whose arm plants are drawn; `seed` is of the draws.

    Raises
    ------
    UsageError
        For a spread or ranges that are none, of what the arm has off, or of an ensemble, which says itself
        how far its plants lie apart.
    ConfigError
        If the comparison has not the three laws that are compared.
    """
    source = load.find_source(source, "ensemble")
    tree = strict_yaml.load(source.text, source.origin)
    if not isinstance(tree, dict) or tree.get("experiment") != "compare":
        if spread is not None or ranges:
            option = "--range" if spread is None else "--spread"
            message = "is for plants around an arm of your own"
            raise UsageError(message, where=option, hint="name its comparison, --config compare.yaml")
        return load_ensemble(source, overrides=overrides, seed=seed)
    if spread is not None and not 0.0 < spread <= MOST - 1.0:
        raise UsageError(f"must be above 0 and at most {MOST - 1.0:g}, found {spread:g}", where="--spread")
    base = load_config(source, "compare", overrides=overrides)
    assert isinstance(base.config, CompareConfig)
    own = _ranges_on(base.config, ranges)
    if missing := PRINTED_LAWS.keys() - base.config.control.laws.keys():
        words = f"control.laws: missing {', '.join(sorted(missing))}, which others are compared with"
        raise ConfigError(words, where=base.origin)
    shipped = load_ensemble(None, seed=seed)
    content = {"ranges": shipped.config.model_dump(mode="json"), "base": base.sha256, "spread": spread}
    return replace(
        shipped,
        base=base,
        tree=base.tree,
        sha256=load.config_digest(content | ({"own": own} if own else {})),
        origin=base.origin,
        around=Around(base.config.manipulator.name, spread, own),
    )


def with_all_controllers(loaded: LoadedEnsemble) -> LoadedEnsemble:
    """Plants for a study of runs: their comparison must have those of the three controllers.

    Raises
    ------
    ConfigError
        If it lacks one.
    """
    runs = loaded.compare.runs
    for name in PRINTED_LAWS:
        if name not in runs or runs[name].law != name:
            message = f"runs: needs a run {name} with the controller of that name, to compare them"
            raise ConfigError(message, where=loaded.origin)
    return loaded


def draws_rows(reading: Reading) -> list[str]:
    """Settings of a reading whose numbers are drawn from the ranges of the paper's arm."""
    return [f"{name}={value}" for name, value in reading.settings if (name, value) in _DRAWING]


def readings_on(loaded: LoadedEnsemble, names: str) -> tuple[Reading, ...]:
    """Readings by their names; around an arm the printed one leaves its comparison as it is.

    Raises
    ------
    UsageError
        For an unknown one. Around an arm also for one that draws from the ranges of the paper's arm, or that
        the comparison lacks something for.
    """
    readings = named_readings(names)
    for reading in readings if loaded.around else ():
        if drawing := draws_rows(reading):
            message = f"{drawing[0]} draws from the ranges of the paper's arm"
            hint = "say it in the comparison: control.readings, reference, start_offset, friction_scale"
            raise UsageError(message, where="--readings", hint=hint)
        try:
            changed = under(reading, loaded.compare, {})
            CompareConfig.model_validate(changed.model_dump(mode="json", exclude_none=True))
        except ValueError as error:
            message = f"the comparison cannot be run under {reading.name}: {error}"
            raise UsageError(message, where="--readings") from error
    return readings
