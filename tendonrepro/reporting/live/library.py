"""Code of the page: functions and models of all presets, equal ones once."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.readings import replaced
from tendonrepro.configuration.models.reference import MinimumJerk, Ramp, ReferenceConfig, Sampled
from tendonrepro.errors import UsageError
from tendonrepro.reporting.live.controls import (
    MOTIONS,
    inputs_of,
)
from tendonrepro.reporting.live.model import Code, law_code, motion_code, plant_code

STROKES: Mapping[str, type[MinimumJerk] | type[Ramp]] = {"minimum_jerk": MinimumJerk, "ramp": Ramp}
"""Models of `MOTIONS`."""
DRY_FRICTION = "manipulator.friction.winch.coulomb"
"""Off in most arms; a plant without it takes two thirds of the time."""


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
    for other in _references(config):
        code, turns = motion_code(replaced(config, "reference", other), inputs, loaded.folder)
        motions.append(f"{other.kind}:{library.entry(code)}")
    plant = library.entry(plant_code(config, inputs))
    dry = [place for place, (key, _) in enumerate(inputs.numbers) if key == DRY_FRICTION]
    plants = f"plant:{plant},dry:{dry}"
    if not config.manipulator.friction.winch.coulomb.si[-len(config.joints) :].any():
        plants += f",smooth:{library.entry(plant_code(config, inputs, DRY_FRICTION))}"
    text = f"{{{plants},laws:{{{','.join(parts)}}},motions:{{{','.join(motions)}}}}}"
    return library.add(text), turns


def _references(config: CompareConfig) -> list[ReferenceConfig]:
    """The reference; if it is a stroke, every kind of stroke with its numbers."""
    if config.reference.kind not in MOTIONS:
        return [config.reference]
    numbers = dict(config.reference)
    return [shape.model_construct(**numbers | {"kind": kind}) for kind, shape in STROKES.items()]


def comparison(loaded: LoadedConfig) -> CompareConfig:
    """The configuration, if the page can run it; a UsageError if not."""
    config = loaded.config
    assert isinstance(config, CompareConfig)
    if isinstance(config.reference, Sampled):
        message = "a motion from a file does not run in the page"
        hint = "use one of the other kinds of reference, such as minimum_jerk"
        raise UsageError(message, where=f"{loaded.origin}: reference", hint=hint)
    return config
