"""A preset: a configuration as the page's script takes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from operator import attrgetter
from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import RUNS, unloaded_run
from tendonrepro.configuration.models.experiment import CompareRun
from tendonrepro.configuration.models.readings import AXES
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.configuration.quantity import Moving, Physical, Quantity, Scalar, to_si
from tendonrepro.configuration.shown import run_in_words
from tendonrepro.experiments.loops import all_loops, friction_scale
from tendonrepro.experiments.rig import start_angles
from tendonrepro.reporting.live.controls import (
    GROUPS,
    LEFT_OUT,
    MOTION,
    MOTIONS,
    READING,
    RUN,
    START_HELP,
    Knob,
    entries_of,
    inputs_of,
    knobs_of,
    menus_of,
)
from tendonrepro.reporting.live.model import Library, comparison, model_source
from tendonrepro.results.paper import compares_as_paper
from tendonrepro.results.summary import LOADS
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import STEPS, TOLERANCE, prepared_loops

COARSE = 1
"""Steps fewer while a slider is being dragged."""


def preset(loaded: LoadedConfig, name: str, title: str, about: str, library: Library) -> dict[str, object]:
    """A configuration as the page's script takes it."""
    config = comparison(loaded)
    loops = all_loops(loaded)
    model, turns = model_source(loaded, library)
    papers = compares_as_paper(config)
    controls = [*_shared_controls(config), *_run_controls(config)]
    groups = {control["group"] for control, _ in controls}
    return {
        "name": name,
        "title": title,
        "about": about,
        "notes": ["Noise is left out here."] if any(loop.is_noisy for loop in loops.values()) else [],
        "model": model,
        "motion": config.reference.kind,
        "turns": turns,
        "joints": config.joints,
        "n": len(config.joints),
        "L": config.sampling_period.si,
        "posture": [float(angle) for angle in np.degrees(start_angles(config))],
        "limit": config.status.divergence_limit.si,
        "ringing": config.status.ringing_frequency.si,
        "share": config.status.ringing_share.si,
        "groups": [group for group in GROUPS if group in groups],
        "controls": [[library.knob(said), *own] for said, own in controls],
        "choices": _choices(config),
        "runs": _runs(config, loops, papers=papers),
        "printed": papers,
        "loads": LOADS if set(LOADS.values()) <= set(config.runs) else None,
        "tree": loaded.tree,
    }


PageControl: TypeAlias = tuple[dict[str, object], tuple[float, float]]
"""What is said of a control under any configuration; its value, and the file's unit in the page's."""


def _shared_controls(config: CompareConfig) -> list[PageControl]:
    places = {number: place for place, number in enumerate(inputs_of(config).numbers)}
    return [
        _control(config, knob, entry, part, {"place": places[knob.key, entry]})
        for knob in knobs_of(config)
        for entry, part in entries_of(config, knob.key)
    ]


def _run_controls(config: CompareConfig) -> list[PageControl]:
    """Where each run starts, and the payload of those that carry one."""
    # Of no single run: the script takes it from the errors of all.
    controls = [_control(config, LEFT_OUT, None, "", {"run": "", "place": 0})]
    start, load = RUN
    for name, run in config.runs.items():
        own = start._replace(
            label=start.label.format(run_in_words(name)), help=START_HELP if len(controls) == 1 else ""
        )
        for k, joint in enumerate(config.joints):
            at = {"run": name, "place": 2 + k}
            controls.append(_control(config, own, k, f"joint {joint}", at, name))
        if run.payload.si > 0.0 or unloaded_run(name):
            own = load._replace(label=load.label.format(run_in_words(name)))
            controls.append(_control(config, own, None, "", {"run": name, "place": 0}, name))
    return controls


def _control(
    config: CompareConfig,
    knob: Knob,
    entry: int | None,
    part: str,
    at: dict[str, object],
    run: str | None = None,
) -> PageControl:
    """One number that can be moved, and where it goes."""
    path = knob.key if run is None else f"runs.{run}.{knob.key}"
    root = config if run is None else config.runs[run]
    *above, last = knob.key.split(".")
    section = attrgetter(".".join(above))(root) if above else root
    quantity: Quantity = getattr(section, last) or absent(config, entry, knob.unit)
    factor = 1.0 if quantity.unit == knob.unit else to_si(1.0, quantity.unit) / to_si(1.0, knob.unit)
    value = quantity.value if entry is None else quantity.value[entry]
    field = type(section).model_fields[last]
    rule = next(_rules((*field.metadata, field.annotation)))
    said = {
        "key": path,
        "entry": entry,
        "part": part,
        "label": knob.label,
        "group": knob.group,
        "unit": knob.unit,
        **({"help": knob.help} if knob.help else {}),
        "slider": [knob.least, knob.most],
        "step": knob.step,
        **_limits(rule, knob.unit),
        **at,
    }
    return said, (value * factor, factor)


def absent(config: CompareConfig, entry: int | None, unit: str) -> Scalar | Moving:
    """Zero, for a key that a configuration may lack."""
    if entry is None:
        return Scalar(value=0.0, unit=unit, source="assumed: none")
    return Moving(value=(0.0,) * len(config.joints), unit=unit, source="assumed: none")


def _rules(parts: Iterable[object]) -> Iterator[Physical]:
    """What a field asks of its quantity, also of one that may be absent."""
    for part in parts:
        if isinstance(part, Physical):
            yield part
        yield from _rules(get_args(part))


def _limits(rule: Physical, unit: str) -> dict[str, object]:
    """Numbers that the configuration allows, in a unit; where there is no limit, none is named."""
    limits: dict[str, object] = {}
    for name, limit in rule.limits.items():
        side = "least" if name in ("above", "at_least") else "most"
        limits[side] = limit / to_si(1.0, unit)
        if name in ("above", "below"):
            limits[f"open_{side}"] = True
    return limits


def _choices(config: CompareConfig) -> list[dict[str, object]]:
    """Readings that can be chosen, and the kind of stroke."""
    readings, numbers = config.control.readings, len(inputs_of(config).numbers)
    choices = []
    for k, menu in enumerate(menus_of(config)):
        value = getattr(readings, menu.name)
        origin = "as published" if value == AXES[menu.name].printed else "not as published"
        said = _choice(f"control.readings.{menu.name}", menu.label, READING, menu.words, value)
        choices.append({**said, "origin": origin, "help": menu.help, "place": numbers + k})
    kind = config.reference.kind
    if kind in MOTIONS:
        said = _choice("reference.kind", "Motion", MOTION, MOTIONS, kind)
        choices.append({**said, "origin": "assumed", "help": "", "place": None})
    return choices


def _choice(key: str, label: str, group: str, words: Mapping[str, str], value: str) -> dict[str, object]:
    shown = {"values": [*words], "words": [*words.values()], "value": value}
    return {"id": key, "label": label, "group": group, **shown}


def _runs(config: CompareConfig, loops: Mapping[str, Loop], *, papers: bool) -> list[dict[str, object]]:
    """Runs with their steps a sample, by the rule of the batch, and the printed errors."""
    places = dict(enumerate(loops.values()))
    steps = {name: int(rule.max()) for name, rule in zip(loops, _steps(places), strict=True)}
    runs = []
    for name, run in config.runs.items():
        printed = None
        if papers and name in RUNS:
            printed = {
                metric: published().per_joint(f"{row_of(name)}.{metric}", config.joints) for metric in METRICS
            }
        enough = steps[name] or STEPS[-1]
        runs.append(
            {
                "name": name,
                "label": run_in_words(name),
                "short": name.removeprefix("controller_"),
                "law": run.law,
                "rr": _of_run(run, len(config.joints)),
                "steps": enough,
                "coarse": max(1, enough - COARSE),
                "compared": not unloaded_run(name),
                "printed": printed,
            }
        )
    return runs


def _of_run(run: CompareRun, n: int) -> list[float]:
    """Payload, factor on friction, start; a control writes over them, in its unit."""
    offset = np.zeros(n) if run.start_offset is None else np.degrees(run.start_offset.si)
    return [run.payload.si, friction_scale(run), *map(float, offset)]


def _steps(loops: Mapping[int, Loop]) -> list[NDArray[np.int64]]:
    return [ready.steps for ready in prepared_loops([*loops.values()], TOLERANCE)]
