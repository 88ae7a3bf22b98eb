"""The page of ``tendonrepro live``: presets, their code, scripts and styles, in one HTML file."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import get_args

import numpy as np

from tendonrepro import __version__
from tendonrepro.configuration.load import CompareConfig, LoadedConfig, load_config
from tendonrepro.configuration.models.control import RUNS, run_in_words, unloaded_run
from tendonrepro.configuration.models.readings import AXES
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.configuration.quantity import Physical, Quantity, to_si
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.rig import start_angles
from tendonrepro.files import Json, refuse_foreign, write_atomically
from tendonrepro.reporting.live import controls
from tendonrepro.reporting.live.controls import Knob
from tendonrepro.reporting.live.model import Library, comparison, model_source
from tendonrepro.results.paper import compares_as_paper
from tendonrepro.results.summary import LOADS
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import STEPS, TOLERANCE, prepared_loops

FOLDER = Path(__file__).parent / "page"
"""With ``dist/uPlot.iife.min.js`` and ``dist/uPlot.min.css`` of npm's uPlot 1.6.32, unchanged."""


def build_page(presets: Sequence[Json], library: Library) -> str:
    """The HTML file."""
    # Presets repeat each other, so they are packed.
    data = gzip.compress(json.dumps(presets).encode(), mtime=0)
    parts = {
        "UPLOT_STYLE": _file("uplot.css"),
        "STYLE": _compact("page.css"),
        "ENGINE": f"{_compact('engine.js')}\n{library.source()}",
        "UPLOT_CODE": f"/*\n{_file('uplot-LICENSE')}*/\n{_file('uplot.js')}",
        "DATA": base64.b64encode(data).decode("ascii"),
        "PAGE_CODE": _compact("page.js"),
        "VERSION": __version__,
    }
    return re.sub("|".join(parts), lambda word: parts[word[0]], _file("page.html"))


def _file(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _compact(name: str) -> str:
    """A script or style sheet without indentation and lines of comment."""
    return re.sub(r"^(\s+|//.*\n)+", "", _file(name), flags=re.M)


NEAR = "assumed: chosen to come near Table 2"
RAMPS: Mapping[str, object] = {
    "reference": {
        "kind": "ramp",
        "amplitude": {"value": [3.4, 8.7], "unit": "deg", "source": NEAR},
        "rise": {"value": 3.6, "unit": "s", "source": NEAR},
        "hold": {"value": 1.4, "unit": "s", "source": NEAR},
        "periods": {"value": 2, "unit": "1", "source": "assumed: as many as as published"},
    },
    "control.readings.reference_acceleration": "absent",
}
"""Straight ramps, whose acceleration no law gets."""

APART: Mapping[str, object] = {
    "runs.controller_2.start_offset": {"value": [-1.1, -1.1], "unit": "deg", "source": NEAR},
    "runs.controller_3.start_offset": {"value": [-1.8, -1.7], "unit": "deg", "source": NEAR},
}
"""Starts found by a search: with them the typical arm comes near Table 2."""

SHIPPED: Sequence[tuple[str, str, str, str | None, Mapping[str, object]]] = (
    (
        "published",
        "As published",
        "Equations, gains and encoder as published. Arm and motion are assumed: a typical one of plausible "
        "ranges, that of tendonrepro compare. Every run starts on its reference and gets its acceleration.",
        None,
        {},
    ),
    (
        "ramps",
        "Straight ramps",
        "The reference is a straight ramp, and its acceleration is not fed forward. The order is as before.",
        None,
        RAMPS,
    ),
    (
        "apart",
        "Runs that start apart",
        "The same ramps. Controllers 2 and 3 start one to two degrees below their reference, Controller 1 "
        "starts on it. Ramps and starts were chosen to come near Table 2, so agreement proves nothing.",
        None,
        {**RAMPS, **APART},
    ),
    (
        "weights",
        "Changed weights",
        "As published, but the two delayed estimates weigh 1 + α and −α: Eq. (15) with a changed sign.",
        None,
        {"control.readings.weights": "extrapolating"},
    ),
    (
        "delta_in_degrees",
        "Δ in degrees",
        "As published, but Δ = 0.2 is understood in degrees. The paper gives no unit.",
        None,
        {"control.readings.Delta_unit": "deg"},
    ),
    (
        "fitted",
        "Fitted arm",
        "An arm and a motion that were fitted to Tables 2 and 3, so agreement proves nothing.",
        "closest",
        {},
    ),
)
"""Name, title and words of the presets that tell the paper's story; their configuration and its changes."""


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
    moved = [*_shared_controls(config), *_run_controls(config)]
    groups = {control["group"] for control in moved}
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
        "groups": [group for group in controls.GROUPS if group in groups],
        "controls": moved,
        "choices": _choices(config),
        "runs": _runs(config, loops, papers=papers),
        "printed": papers,
        "loads": LOADS if set(LOADS.values()) <= set(config.runs) else None,
        "tree": loaded.tree,
    }


def _shared_controls(config: CompareConfig) -> Iterator[Json]:
    places = {number: place for place, number in enumerate(controls.inputs_of(config).numbers)}
    for knob in controls.knobs_of(config):
        for entry, part in controls.entries_of(config, knob.key):
            yield _control(config, knob, entry, part, {"place": places[knob.key, entry]})


def _run_controls(config: CompareConfig) -> Iterator[Json]:
    """Where each run starts, and the payload of those that carry one."""
    # Of no single run: the script takes it from the errors of all.
    yield _control(config, controls.LEFT_OUT, None, "", {"run": "", "place": 0})
    start, load = controls.RUN
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
    quantity: Quantity | None = getattr(section, last)
    value, factor, source = 0.0, 1.0, "assumed: none"
    if quantity is not None:
        value = quantity.value if entry is None else quantity.value[entry]
        factor, source = controls.factor_to(knob.unit, quantity), quantity.source
    field = type(section).model_fields[last]
    rule = next(_rules((*field.metadata, field.annotation)))
    origin = source.partition(":")[0]
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
        "source": source,
        "origin": ORIGINS.get(origin, origin),
    }


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
            "group": controls.READING,
            "values": [*menu.words],
            "words": [*menu.words.values()],
            "value": (value := getattr(config.control.readings, menu.name)),
            "origin": "as published" if value == AXES[menu.name].printed else "not as published",
            "help": menu.help,
            "place": place,
        }
        for place, menu in enumerate(controls.menus_of(config), len(controls.inputs_of(config).numbers))
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
                "rr": [run.payload.si, run.friction_factor, *map(float, offset)],
                "steps": enough,
                "coarse": max(1, enough - COARSE),
                "compared": not unloaded_run(name),
                "printed": printed,
            }
        )
    return runs


PAGE = "live.html"
"""Name of the page."""

MARK = b'<meta name="generator" content="live page of tendonrepro'
"""What every page has near its beginning."""


def write_page(path: Path, loaded: LoadedConfig | None, *, force: bool) -> Json:
    """Write the page, a user's configuration among its presets; return what ``--json`` prints.

    It replaces an earlier page, any other file with `force` alone.

    Raises
    ------
    UsageError
        If another file is in the way, or the page cannot run the configuration.
    """
    refuse_foreign(path, MARK, force=force)
    library, presets = Library(), []
    if loaded is not None:
        about = f"The configuration {Path(loaded.origin).name}, with its own arm, gains and motion."
        presets.append(preset(loaded, "own", "Your configuration", about, library))
    for name, title, about, config, changes in SHIPPED:
        shipped = load_config(config, "compare", overrides=changes)
        presets.append(preset(shipped, name, title, about, library))
    content = build_page(presets, library).encode()
    write_atomically(path, content)
    names = [made["name"] for made in presets]
    return {"schema_version": 1, "path": str(path), "bytes": len(content), "presets": names}


def page_beside(path: Path, loaded: LoadedConfig | None, talk: Talk, *, force: bool) -> Json:
    """Write the page; it has no preset of a user's own configuration that it cannot run."""
    try:
        return write_page(path, loaded, force=force)
    except UsageError as error:
        talk.note(f"{path.name} has no preset of your configuration: {error.message}")
        return write_page(path, None, force=force)
