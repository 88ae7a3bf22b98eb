"""A preset: a configuration as the page's script takes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from operator import attrgetter
from typing import get_args

import numpy as np

from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import RUNS, unloaded_run
from tendonrepro.configuration.models.readings import AXES
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.configuration.quantity import Moving, Physical, Quantity, Scalar, to_si
from tendonrepro.configuration.shown import run_in_words
from tendonrepro.experiments.loops import all_loops, friction_scale
from tendonrepro.experiments.rig import start_angles
from tendonrepro.files import Json
from tendonrepro.reporting.live.controls import (
    GROUPS,
    LEFT_OUT,
    READING,
    RUN,
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


ORIGINS = {"printed": "published", "identified": "fitted", "user": "yours"}
"""Where a value comes from, as the page says it; other words stay."""


def preset(loaded: LoadedConfig, name: str, title: str, about: str, library: Library) -> Json:
    """A configuration as the page's script takes it."""
    config = comparison(loaded)
    loops = all_loops(loaded)
    model, turns = model_source(loaded, library)
    papers = compares_as_paper(config)
    controls = [*_shared_controls(config), *_run_controls(config)]
    groups = {control["group"] for control in controls}
    return {
        "name": name,
        "title": title,
        "about": about,
        "notes": ["Noise is left out here."] if any(loop.is_noisy for loop in loops.values()) else [],
        "model": model,
        "turns": turns,
        "joints": config.joints,
        "n": len(config.joints),
        "L": config.sampling_period.si,
        "posture": [float(angle) for angle in np.degrees(start_angles(config))],
        "limit": config.status.divergence_limit.si,
        "ringing": config.status.ringing_frequency.si,
        "share": config.status.ringing_share.si,
        "groups": [group for group in GROUPS if group in groups],
        "controls": controls,
        "choices": _choices(config),
        "runs": _runs(config, loops, papers=papers),
        "printed": papers,
        "loads": LOADS if set(LOADS.values()) <= set(config.runs) else None,
        "tree": loaded.tree,
    }


def _shared_controls(config: CompareConfig) -> Iterator[Json]:
    places = {number: place for place, number in enumerate(inputs_of(config).numbers)}
    for knob in knobs_of(config):
        for entry, part in entries_of(config, knob.key):
            yield _control(config, knob, entry, part, {"place": places[knob.key, entry]})


def _run_controls(config: CompareConfig) -> Iterator[Json]:
    """Where each run starts, and the payload of those that carry one."""
    # Of no single run: the script takes it from the errors of all.
    yield _control(config, LEFT_OUT, None, "", {"run": "", "place": 0})
    start, load = RUN
    for name, run in config.runs.items():
        words = run_in_words(name)
        own = start._replace(label=start.label.format(words))
        for k, joint in enumerate(config.joints):
            yield _control(config, own, k, f"joint {joint}", {"run": name, "place": 2 + k}, name)
        if run.payload.si > 0.0 or unloaded_run(name):
            own = load._replace(label=load.label.format(words))
            yield _control(config, own, None, "", {"run": name, "place": 0}, name)


def _control(
    config: CompareConfig,
    knob: Knob,
    entry: int | None,
    part: str,
    at: Json,
    run: str | None = None,
) -> Json:
    """One number that can be moved, and where it goes."""
    path = knob.key if run is None else f"runs.{run}.{knob.key}"
    root = config if run is None else config.runs[run]
    above, _, last = knob.key.rpartition(".")
    section = attrgetter(above)(root) if above else root
    quantity: Quantity = getattr(section, last) or absent(config, entry, knob.unit)
    factor = 1.0 if quantity.unit == knob.unit else to_si(1.0, quantity.unit) / to_si(1.0, knob.unit)
    value = quantity.value if entry is None else quantity.value[entry]
    field = type(section).model_fields[last]
    rule = next(_rules((*field.metadata, field.annotation)))
    origin = quantity.source.partition(":")[0]
    return {
        "id": f"{path}.{part.removeprefix('joint ')}" if part else path,
        "key": path,
        "entry": entry,
        "part": part,
        "label": knob.label,
        "group": knob.group,
        "unit": knob.unit,
        "help": knob.help,
        "slider": [knob.least, knob.most],
        "step": knob.step,
        **_limits(rule, knob.unit),
        **at,
        "value": value * factor,
        "factor": factor,
        "source": quantity.source,
        "origin": ORIGINS.get(origin, origin),
    }


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


def _limits(rule: Physical, unit: str) -> Json:
    """Numbers that the configuration allows, in a unit; where there is no limit, none is named."""
    limits: Json = {}
    for name, limit in rule.limits.items():
        side = "least" if name in ("above", "at_least") else "most"
        limits[side] = limit / to_si(1.0, unit)
        limits[f"open_{side}"] = name in ("above", "below")
    return limits


def _choices(config: CompareConfig) -> list[Json]:
    """Readings that can be chosen."""
    return [
        {
            "id": f"control.readings.{menu.name}",
            "label": menu.label,
            "group": READING,
            "values": [*menu.words],
            "words": [*menu.words.values()],
            "value": (value := getattr(config.control.readings, menu.name)),
            "origin": "as published" if value == AXES[menu.name].printed else "not as published",
            "help": menu.help,
            "place": place,
        }
        for place, menu in enumerate(menus_of(config), len(inputs_of(config).numbers))
    ]


def _runs(config: CompareConfig, loops: Mapping[str, Loop], *, papers: bool) -> list[Json]:
    """Runs with their steps a sample, by the rule of the batch, and the printed errors."""
    runs = []
    steps = [int(ready.steps.max()) for ready in prepared_loops([*loops.values()], TOLERANCE)]
    for (name, run), needed in zip(config.runs.items(), steps, strict=True):
        printed = None
        if papers and name in RUNS:
            printed = {
                metric: published().per_joint(f"{row_of(name)}.{metric}", config.joints) for metric in METRICS
            }
        enough = needed or STEPS[-1]
        offset = np.zeros(len(config.joints)) if run.start_offset is None else np.degrees(run.start_offset.si)
        runs.append(
            {
                "name": name,
                "label": run_in_words(name),
                "short": name.removeprefix("controller_"),
                "law": run.law,
                # Payload, factor on friction, start; a control writes over them, in its unit.
                "rr": [run.payload.si, friction_scale(run), *map(float, offset)],
                "steps": enough,
                "coarse": max(1, enough - COARSE),
                "compared": not unloaded_run(name),
                "printed": printed,
            }
        )
    return runs
