"""The page: presets, the code they need, and the numbers that stand beside them, in one HTML file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tendonrepro import __version__
from tendonrepro.configuration.load import CompareConfig, LoadedConfig, load_config
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.experiment import CompareRun
from tendonrepro.configuration.models.readings import AXES, replaced
from tendonrepro.configuration.models.reference import Sampled
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.configuration.quantity import Moving, Physical, Quantity, Scalar, to_si
from tendonrepro.errors import UsageError
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
    choices_of,
    entries_of,
    inputs_of,
    knobs_of,
)
from tendonrepro.reporting.live.model import Code, law_code, motion_code, plant_code
from tendonrepro.results.paper import compares_as_paper
from tendonrepro.results.summary import LOADS, PAYLOAD
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.parts import is_noisy, plant_needs
from tendonrepro.simulation.resolution import STEPS, TOLERANCE

FOLDER = Path(__file__).parent / "page"

UPLOT = {
    "uplot.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uplot.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}
"""SHA-256 of ``dist/uPlot.iife.min.js`` and ``dist/uPlot.min.css`` of npm's uPlot 1.6.32, unchanged."""

DRY_FRICTION = "manipulator.friction.winch.coulomb"
"""Off in most arms; a plant without it takes two thirds of the time."""

COARSE = 1
"""Steps fewer while a slider is being dragged."""

RAMPS = {
    "reference.kind": "ramp",
    "reference.amplitude.2": 10.8,
    "reference.amplitude.3": 10.8,
    "reference.rise": 2.07,
    "reference.hold": 1.13,
    "control.readings.reference_acceleration": "absent",
}
"""Straight ramps, whose acceleration no law gets."""

APART = {
    "runs.controller_2.start_offset.2": -0.75,
    "runs.controller_2.start_offset.3": -0.48,
    "runs.controller_3.start_offset.2": -1.33,
    "runs.controller_3.start_offset.3": -1.07,
}
"""Starts, deg, found by hand: with them the plain arm comes near to Table 2."""

VARIANTS: Sequence[dict[str, object]] = (
    {
        "name": "no_acceleration",
        "of": "published",
        "title": "No acceleration",
        "about": "The reference is a straight ramp, and its acceleration is not fed forward. That makes an "
        "error of its own, nearly the same for all controllers, and α hardly shows.",
        "values": RAMPS,
    },
    {
        "name": "apart",
        "of": "published",
        "title": "Runs that start apart",
        "about": "The same ramps. Controllers 2 and 3 start about a degree off their reference, Controller 1 "
        "starts on it. The starts were chosen to come near to Table 2, so agreement proves nothing.",
        "values": {**RAMPS, **APART},
    },
    {
        "name": "weights",
        "of": "published",
        "title": "Changed weights",
        "about": "As published, but the two delayed estimates weigh 1 + α and −α: Eq. (15) with a changed "
        "sign.",
        "values": {"control.readings.weights": "extrapolating"},
    },
    {
        "name": "delta_in_degrees",
        "of": "published",
        "title": "Δ in degrees",
        "about": "As published, but Δ = 0.2 is understood in degrees. The paper gives no unit.",
        "values": {"control.readings.Delta_unit": "deg"},
    },
)
"""Presets that are another one with some values changed."""


@dataclass
class Library:
    """Code of all presets: equal functions stand once."""

    functions: dict[str, str] = field(default_factory=dict)
    models: list[str] = field(default_factory=list)
    knobs: list[dict[str, object]] = field(default_factory=list)

    def knob(self, control: dict[str, object]) -> int:
        """Number of what is said of a control, new or known."""
        if control not in self.knobs:
            self.knobs.append(control)
        return self.knobs.index(control)

    def add(self, text: str) -> int:
        """Number of a model, new or known."""
        if text not in self.models:
            self.models.append(text)
        return self.models.index(text)

    def entry(self, code: Code, **sizes: int) -> str:
        """Two functions and their sizes as a JavaScript object."""
        parts = [f"prepare:{self._name(code.prepare)}", f"run:{self._name(code.run)}"]
        parts += [f"{name}:{size}" for name, size in {"constants": code.constants, **sizes}.items()]
        parts.append(f"reads:{json.dumps(code.reads, separators=(',', ':'))}")
        return f"{{{','.join(parts)}}}"

    def _name(self, source: str) -> str:
        body = re.sub(r"^function \w+", "", source)
        return self.functions.setdefault(body, f"f{len(self.functions)}")

    def source(self) -> str:
        """All functions, and the table of models."""
        functions = [f"function {name}{body}" for body, name in self.functions.items()]
        return "\n".join([*functions, f"const MODELS = [{','.join(self.models)}];"])


def model_source(loaded: LoadedConfig, library: Library) -> tuple[int, list[list[int]]]:
    """Trace a comparison; return the number of its model, and in which turns its joints move."""
    config = comparison(loaded)
    inputs = inputs_of(config)
    laws = dict.fromkeys(run.law for run in config.runs.values())
    parts = []
    for name in laws:
        code = law_code(config, name, inputs)
        parts.append(f"{name}:{library.entry(code, memory=code.written)}")
    motions: list[str] = []
    turns: list[list[int]] = []
    kinds = list(MOTIONS) if config.reference.kind in MOTIONS else [config.reference.kind]
    for kind in kinds:
        other = config.reference.model_copy(update={"kind": kind})
        code, turns = motion_code(replaced(config, "reference", other), inputs, loaded.folder)
        motions.append(f"{kind}:{library.entry(code)}")
    plant = library.entry(plant_code(config, inputs))
    dry = [place for place, (key, _) in enumerate(inputs.numbers) if key == DRY_FRICTION]
    plants = f"plant:{plant},dry:{dry}"
    if not config.manipulator.friction.winch.coulomb.si[-len(config.joints) :].any():
        plants += f",smooth:{library.entry(plant_code(config, inputs, DRY_FRICTION))}"
    text = f"{{{plants},laws:{{{','.join(parts)}}},motions:{{{','.join(motions)}}}}}"
    return library.add(text), turns


def comparison(loaded: LoadedConfig) -> CompareConfig:
    """The configuration, if the page can run it; a UsageError if not."""
    config = loaded.config
    assert isinstance(config, CompareConfig)
    if isinstance(config.reference, Sampled):
        message = "a motion from a file does not run in the page"
        hint = "use one of the other kinds of reference, such as minimum_jerk"
        raise UsageError(message, where=f"{loaded.origin}: reference", hint=hint)
    return config


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
        "notes": _notes(loops),
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
        "tables": _tables(config),
        "figures": _figures(config),
        "tries": _tries(config),
        "tree": loaded.tree,
    }


def _notes(loops: Mapping[str, Loop]) -> list[str]:
    notes = []
    if any(map(is_noisy, loops.values())):
        notes.append("Noise of encoders and torque is left out here.")
    return notes


Control: TypeAlias = tuple[dict[str, object], tuple[float, float]]
"""What is said of a control under any configuration; its value, and the file's unit in the page's."""


def _shared_controls(config: CompareConfig) -> list[Control]:
    places = {number: place for place, number in enumerate(inputs_of(config).numbers)}
    return [
        _control(config, knob, entry, part, {"place": places[knob.key, entry]})
        for knob in knobs_of(config)
        for entry, part in entries_of(config, knob.key)
    ]


def _run_controls(config: CompareConfig) -> list[Control]:
    """Where each run starts, and the payload of those that carry one."""
    # Of no single run: the script takes it from the errors of all.
    controls = [_control(config, LEFT_OUT, None, "", {"run": "", "place": 0})]
    start, load = RUN
    for name, run in config.runs.items():
        own = start._replace(
            label=start.label.format(_label(name)), help=START_HELP if len(controls) == 1 else ""
        )
        for k, joint in enumerate(config.joints):
            at = {"run": name, "place": 2 + k}
            controls.append(_control(config, own, k, f"joint {joint}", at, name))
        if run.payload.si > 0.0 or name.endswith(PAYLOAD):
            own = load._replace(label=load.label.format(_label(name)))
            controls.append(_control(config, own, None, "", {"run": name, "place": 0}, name))
    return controls


def _control(
    config: CompareConfig,
    knob: Knob,
    entry: int | None,
    part: str,
    at: dict[str, object],
    run: str | None = None,
) -> Control:
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
        "id": path + (f".{part.removeprefix('joint ')}" if part else ""),
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
    numbers = len(inputs_of(config).numbers)
    choices = []
    for k, choice in enumerate(choices_of(config)):
        value, axis = getattr(config.control.readings, choice.name), AXES[choice.name]
        choices.append(
            {
                "id": f"control.readings.{choice.name}",
                "label": choice.label,
                "group": READING,
                "values": list(choice.words),
                "words": list(choice.words.values()),
                "value": value,
                "origin": "as published" if value == axis.printed else "not as published",
                "help": choice.help,
                "place": numbers + k,
            }
        )
    if config.reference.kind in MOTIONS:
        kind = config.reference.kind
        choices.append(
            {
                "id": "reference.kind",
                "label": "Motion",
                "group": MOTION,
                "values": list(MOTIONS),
                "words": list(MOTIONS.values()),
                "value": kind,
                "origin": "assumed",
                "help": "",
                "place": None,
            }
        )
    return choices


def _label(run: str) -> str:
    """What a run is called."""
    words = run.removesuffix(PAYLOAD).replace("_", " ").capitalize()
    return f"{words} with payload" if run.endswith(PAYLOAD) else words


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
                "label": _label(name),
                "short": name.removeprefix("controller_"),
                "law": run.law,
                "rr": _of_run(run, len(config.joints)),
                "steps": enough,
                "coarse": max(1, enough - COARSE),
                "compared": not name.endswith(PAYLOAD),
                "printed": printed,
            }
        )
    return runs


def _of_run(run: CompareRun, n: int) -> list[float]:
    """Payload, factor on friction, start; a control writes over them, in its unit."""
    offset = np.zeros(n) if run.start_offset is None else np.degrees(run.start_offset.si)
    return [run.payload.si, friction_scale(run), *map(float, offset)]


def _steps(loops: Mapping[int, Loop]) -> list[NDArray[np.int64]]:
    return [*plant_needs(loops, TOLERANCE, map)[0].values()]


def _tables(config: CompareConfig) -> list[dict[str, object]]:
    compared = [name for name in config.runs if not name.endswith(PAYLOAD)]
    tables: list[dict[str, object]] = [
        {
            "caption": "Table 2, mean errors of the runs",
            "rows": [{"run": name, "label": _label(name)} for name in compared],
        }
    ]
    if set(LOADS.values()) <= set(config.runs):
        words = {"no_load": "no load", "with_load": "with payload"}
        rows = [{"run": run, "label": words[row]} for row, run in LOADS.items()]
        tables.append({"caption": "Table 3, Controller 1", "rows": rows})
    return tables


def _figures(config: CompareConfig) -> list[dict[str, object]]:
    compared = [name for name in config.runs if not name.endswith(PAYLOAD)]
    figures: list[dict[str, object]] = [
        {"title": "Fig. 14: tracking", "runs": compared, "quantities": ["q", "e"]},
        {
            "title": "Fig. 15: sliding variable, estimate and torque",
            "runs": compared,
            "quantities": ["s", "H_hat", "tau"],
        },
    ]
    if set(LOADS.values()) <= set(config.runs):
        figures.append(
            {
                "title": "Fig. 16: Controller 1 with and without payload",
                "runs": [*LOADS.values()],
                "quantities": ["q", "e"],
            }
        )
    return figures


def _tries(config: CompareConfig) -> list[dict[str, object]]:
    """Changes of one thing that show what it does."""

    def alpha(value: float) -> dict[str, float]:
        return {f"control.gains.alpha.{joint}": value for joint in config.joints}

    tries: list[dict[str, object]] = [
        {"label": "α = 0", "set": alpha(0.0)},
        {"label": "α = 0.5", "set": alpha(0.5)},
    ]
    if any(choice.name == "reference_acceleration" for choice in choices_of(config)):
        tries.append(
            {"label": "No acceleration", "set": {"control.readings.reference_acceleration": "absent"}}
        )
    last = ([name for name in config.runs if not name.endswith(PAYLOAD)] or [*config.runs])[-1]
    start = {f"runs.{last}.start_offset.{joint}": -1.0 for joint in config.joints}
    tries.append({"label": f"{_label(last)} starts 1° below", "set": start})
    tries.append({"label": "Leave out the first 2 s", "set": {"errors_from": 2}})
    return tries


def build_page(presets: Sequence[dict[str, object]], library: Library) -> str:
    """The HTML file."""
    trees = [tree for preset in presets if isinstance(tree := preset.get("tree"), dict)]
    short = [
        preset | {"tree": _changes(tree, trees[0])}
        if isinstance(tree := preset.get("tree"), dict) and tree is not trees[0]
        else preset
        for preset in presets
    ]
    parts = {
        "UPLOT_STYLE": _file("uplot.css"),
        "STYLE": _compact("page.css"),
        "ENGINE": f"{_compact('engine.js')}\n{library.source()}",
        "UPLOT_CODE": f"/*\n{_file('uplot-LICENSE')}*/\n{_file('uplot.js')}",
        "DATA": _script_json({"knobs": library.knobs, "presets": short}),
        "PAGE_CODE": _compact("page.js"),
        "VERSION": __version__,
    }
    return re.sub("|".join(parts), lambda word: parts[word[0]], _file("page.html"))


def _changes(tree: Mapping[str, object], first: Mapping[str, object]) -> dict[str, object]:
    """What to lay over another configuration for this one; None takes a key away."""
    changes: dict[str, object] = {key: None for key in first if key not in tree}
    for key, value in tree.items():
        before = first.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            if inner := _changes(value, before):
                changes[key] = inner
        elif value != before:
            changes[key] = value
    return changes


def _script_json(data: object) -> str:
    """JSON that cannot end a script."""
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("</", "<\\/")


def _file(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _compact(name: str) -> str:
    """A script or style sheet without indentation and lines of comment."""
    return re.sub(r"^(\s+|//.*\n)+", "", _file(name), flags=re.M)


def shipped_presets(library: Library) -> list[dict[str, object]]:
    """The presets that tell the paper's story; a variant is another preset with some values changed."""
    published_ = preset(
        load_config("plain", "compare"),
        "published",
        "As published",
        "Equations, gains and encoder as published, on the plain arm of middling numbers.",
        library,
    )
    fitted = preset(
        load_config("closest", "compare"),
        "fitted",
        "Fitted arm",
        "An arm and a motion that were fitted to Tables 2 and 3, so agreement proves nothing.",
        library,
    )
    return [published_, *VARIANTS, fitted]
