"""Plants to draw, and readings to run them under: those of an ensemble, or around the arm of a comparison."""

from __future__ import annotations

from dataclasses import replace

from tendonrepro.configuration.around import Around, Ranges, ranges_of, refuse_off, spread_of
from tendonrepro.configuration.ensemble import LoadedEnsemble, load_ensemble
from tendonrepro.configuration.load import ConfigLike, config_digest, find_source, load_config
from tendonrepro.configuration.models.control import PRINTED_LAWS
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.readings import Reading, named_readings, under
from tendonrepro.configuration.overrides import Overrides
from tendonrepro.configuration.strict_yaml import load
from tendonrepro.errors import ConfigError, UsageError

_DRAWING = {("hardware", "drawn"), ("motion", "ramp"), ("starts", "apart"), ("run_friction", "drawn")}
"""Settings of readings whose numbers are rows of the box."""


def load_around(
    source: ConfigLike,
    spread: float | None = None,
    ranges: Ranges = None,
    *,
    overrides: Overrides | None = None,
    seed: int | None = None,
) -> LoadedEnsemble:
    """Read a comparison, around whose arm plants are drawn; `seed` is of the draws.

    Raises
    ------
    UsageError
        For a spread or ranges that are none, or of what the arm has off.
    ConfigError
        If the comparison has not the three laws that are compared.
    """
    spread, own = spread_of(spread), ranges_of(ranges)
    base = load_config(source, "compare", overrides=overrides)
    assert isinstance(base.config, CompareConfig)
    missing = PRINTED_LAWS.keys() - base.config.control.laws.keys()
    if missing:
        words = f"control.laws: missing {', '.join(sorted(missing))}, which others are compared with"
        raise ConfigError(words, where=base.origin)
    refuse_off(base.config, own)
    shipped = load_ensemble(None, seed=seed)
    content = {"ranges": shipped.config.model_dump(mode="json"), "base": base.sha256, "spread": spread}
    return replace(
        shipped,
        base=base,
        tree=base.tree,
        sha256=config_digest(content | ({"own": own} if own else {})),
        origin=base.origin,
        around=Around(base.config.manipulator.name, spread, own),
    )


def load_plants(
    source: ConfigLike,
    spread: float | None = None,
    ranges: Ranges = None,
    *,
    overrides: Overrides | None = None,
    seed: int | None = None,
) -> LoadedEnsemble:
    """Read an ensemble as it is, or a comparison, around whose arm plants are drawn.

    Raises
    ------
    UsageError
        For a spread or ranges of an ensemble, which says itself how far its plants lie apart.
    """
    text = find_source(source, "ensemble")
    tree = load(text.text, text.origin)
    if isinstance(tree, dict) and tree.get("experiment") == "compare":
        return load_around(text, spread, ranges, overrides=overrides, seed=seed)
    given = {"--spread": spread is not None, "--range": bool(ranges)}
    for option in (name for name, is_given in given.items() if is_given):
        message = "is for plants around an arm of your own"
        raise UsageError(message, where=option, hint="name its comparison, --config compare.yaml")
    return load_ensemble(text, overrides=overrides, seed=seed)


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
