"""A comparison as JavaScript: its configuration's numbers are inputs, its physics is traced.

The package's own functions build plant, law and reference from symbols in place of a configuration's numbers.
So neither an equation nor a conversion of units is written again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array, Numeric, choose
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.readings import replaced
from tendonrepro.configuration.models.reference import Sampled
from tendonrepro.configuration.quantity import Quantity, to_si
from tendonrepro.errors import UsageError
from tendonrepro.experiments import rig
from tendonrepro.experiments.loops import build_law, motions
from tendonrepro.physics.control import Law, unpacked
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.physics.trajectory import at_rest
from tendonrepro.reporting.live.controls import Inputs, factor_to, inputs_of
from tendonrepro.simulation.codegen.lanes import mapped
from tendonrepro.simulation.codegen.printed import Place, PlacesTape, function_source, split_by_input
from tendonrepro.simulation.codegen.symbols import Operand, Symbol, needed
from tendonrepro.simulation.kernel import runge_kutta
from tendonrepro.simulation.loop import Hardware, measure, rest_at, sample, start


class Code(NamedTuple):
    """Functions of one plant or law: the first runs once for its parameters, the second at every step."""

    prepare: str
    run: str
    constants: int
    written: int
    """numbers that the first one writes beside its constants"""
    reads: list[int]
    """inputs that it depends on"""


class _Given(Quantity):
    """A quantity whose numbers are symbols."""

    @property
    def si(self) -> Numeric:
        if isinstance(self.value, tuple):
            return np.array([to_si(number, self.unit) for number in self.value], dtype=object)
        number: Numeric = to_si(self.value, self.unit)
        return number


def given(config: CompareConfig, inputs: Inputs, tape: PlacesTape) -> CompareConfig:
    """The configuration with symbols for the inputs' numbers."""
    symbols = tape.places("pp", len(inputs.numbers))
    for (key, entry), symbol in zip(inputs.numbers, symbols, strict=True):
        quantity, unit = attrgetter(key)(config), inputs.units[key]
        value: Numeric | tuple[Numeric, ...] = symbol
        if entry is not None:
            factor = factor_to(unit, quantity)
            value = tuple(
                symbol if k == entry else number * factor for k, number in enumerate(quantity.value)
            )
        changed = _Given.model_construct(value=value, unit=unit, source=quantity.source)
        config = replaced(config, key, changed)
    return config


def plant_code(config: CompareConfig, inputs: Inputs) -> Code:
    """``plant(pp, rr, kk, zz)`` and ``step(kk, ss, uu, nn)``.

    `rr` is of a run: payload, factor on friction, and by how much its start is off, deg. `zz` receives the
    state in which the arm waits, the torque that holds it, and the motor angles that are read as zero. `uu`
    has torque, time and length of a step, from state `ss` to `nn`.
    """
    tape, n = PlacesTape(), len(config.joints)
    payload, scale = tape.places("rr", 2)
    plant = rig.build_plant(given(config, inputs, tape), payload, scale)  # type: ignore[arg-type]
    begin: Array = np.array([to_si(angle, "deg") for angle in tape.places("rr", n, 2)], dtype=object)
    rest = rest_at(begin, plant)
    state, torque = _array(tape, "ss", 4 * n), _array(tape, "uu", n)
    times: Any = tape.places("uu", 2, n)
    t, h = times
    after, _ = runge_kutta(lambda t, state: state_derivative(t, state, torque, plant), t, state, h)
    return _code(tape, ("plant", _flat(rest), ("pp", "rr"), "zz"), ("step", list(after), ("ss", "uu"), "nn"))


def law_code(config: CompareConfig, name: str, inputs: Inputs) -> Code:
    """``law(pp, zz, kk, bb)`` and ``sample(kk, ss, mm, dd, oo)``.

    `zz` is as of :func:`plant_code`. `mm` holds what the law remembers and commands on their way, at first
    `bb`. `dd` is the desired motion. `oo` receives the next `mm`, then torque on the plant, encoder values,
    commanded and applied torque, estimate, sliding variable, and whether all is in bounds.
    """
    tape, n = PlacesTape(), len(config.joints)
    traced = given(config, inputs, tape)
    choices = tape.places("pp", len(inputs.readings), len(inputs.numbers))
    law = _under(
        traced, list(zip(inputs.readings.items(), choices, strict=True)), partial(build_law, name=name)
    )
    rest, tau, zero = np.split(_array(tape, "zz", 6 * n), [4 * n, 5 * n])
    hardware = _hardware(traced, zero)
    quiet = np.zeros(3 * n)
    if config.control.readings.start == "cold":
        tau = 0.0 * tau
    # Every reference begins at zero, the start posture.
    first = start(measure(rest, quiet, law, hardware), np.zeros(n), tau, law)
    delay = hardware.actuator.delay
    begin = [*_flat(first), *(symbol for _ in range(delay) for symbol in tau)]
    sizes = len(begin) - delay * n
    memory = unpacked(_array(tape, "mm", sizes), first)
    pending = list(_array(tape, "mm", delay * n, sizes).reshape(-1, n))
    q_d, dq_d, ddq_d = _array(tape, "dd", 3 * n).reshape(3, n)
    state = _array(tape, "ss", 4 * n)
    sampled = sample(state, memory, pending, (q_d, dq_d, ddq_d), quiet, law, hardware)
    shown = sampled.torque, sampled.measured[0], sampled.tau, sampled.tau_m, *sampled.signals[:2]
    result = [*_flat([*sampled.memory, *sampled.pending, *shown]), sampled.bounded]
    return _code(tape, ("law", begin, ("pp", "zz"), "bb"), ("sample", result, ("ss", "mm", "dd"), "oo"))


def _hardware(config: CompareConfig, zero: Array) -> Hardware:
    S, S_inv = rig.coupling(config)
    encoders = config.manipulator.encoders
    return Hardware(
        rig.build_encoder(encoders.joint),
        rig.build_encoder(encoders.motor),
        zero,
        rig.build_actuator(config),
        S,
        S_inv,
        config.status.divergence_limit.si,
    )


def _under(
    config: CompareConfig,
    choices: Sequence[tuple[tuple[str, Sequence[str]], Symbol]],
    build: Callable[[CompareConfig], Law],
) -> Law:
    """Record under readings that are chosen by the numbers of their values.

    Such readings change numbers; one that chooses a branch is another trace.
    """
    if not choices:
        return build(config)
    ((name, values), chosen), *rest = choices
    key = f"control.readings.{name}"
    built = _under(replaced(config, key, values[0]), rest, build)
    for k, value in enumerate(values[1:], 1):
        other = _under(replaced(config, key, value), rest, build)
        built = mapped(partial(_either, chosen >= k - 0.5), other, built)
    return built


def _either(condition: Numeric, then: Numeric, otherwise: Numeric) -> Numeric:
    """One leaf of two records, or the other."""
    if isinstance(then, np.ndarray):
        assert isinstance(otherwise, np.ndarray)
        cells = np.empty(then.shape, dtype=object)
        for index in np.ndindex(then.shape):
            cells[index] = _either(condition, then[index], otherwise[index])
        return cells
    if then is otherwise or (not isinstance(then, Symbol) and then == otherwise):
        return then
    if isinstance(then, bool | int):
        message = "a reading that chooses a branch needs a trace of its own"
        raise TypeError(message)
    return choose(condition, then, otherwise)


def _array(tape: PlacesTape, name: str, size: int, first: int = 0) -> Array:
    return np.array(tape.places(name, size, first), dtype=object)


def _flat(parts: Sequence[Array]) -> list[Numeric]:
    return [number for part in parts for number in np.ravel(part)]


Function: TypeAlias = tuple[str, Sequence[Numeric], tuple[str, ...], str]
"""Name, results, arrays read and array written."""


def _code(tape: PlacesTape, once: Function, often: Function) -> Code:
    name, results, arrays, out = once
    run_name, run_results, run_arrays, run_out = often
    kept, lines = split_by_input(tape.lines, run_results, arrays, "kk")
    first: dict[Place, Operand] = {**kept, **{(out, k): value for k, value in enumerate(results)}}
    then = {(run_out, k): value for k, value in enumerate(run_results)}
    return Code(
        function_source(name, tape.lines, first, (*arrays, "kk", out)),
        function_source(run_name, lines, then, ("kk", *run_arrays, run_out)),
        len(kept),
        len(results),
        _inputs_read(tape, first.values()),
    )


def _inputs_read(tape: PlacesTape, results: Iterable[Operand]) -> list[int]:
    used = (tape.lines[name] for name in needed(tape.lines, results))
    return sorted(int(place[1]) for operation, place in used if operation == "input" and place[0] == "pp")


def motion_code(config: CompareConfig, inputs: Inputs, folder: Path) -> tuple[Code, list[list[int]]]:
    """``motion(pp, kk, cc)`` and ``desired(kk, tt, dd)``, and whether each joint moves in each of its turns.

    `cc` receives how long a turn of each joint lasts. `tt` is the time since its turn began. `dd` receives
    angles, velocities and accelerations.
    """
    tape = PlacesTape()
    traced = given(config, inputs, tape)
    joints = motions(traced.reference, traced.joints, folder)
    moving = [next((kind for kind in joint.turns if kind is not at_rest), at_rest) for joint in joints]
    since = tape.places("tt", len(joints))
    shapes = [shape(t) for shape, t in zip(moving, since, strict=True)]  # type: ignore[arg-type]
    desired = [value for part in zip(*shapes, strict=True) for value in part]
    cycles = [joint.period for joint in joints]
    turns = [[int(turn is not at_rest) for turn in joint.turns] for joint in joints]
    return _code(tape, ("motion", cycles, ("pp",), "cc"), ("desired", desired, ("tt",), "dd")), turns


@dataclass
class Library:
    """Code of all presets: equal functions stand once."""

    functions: dict[str, str] = field(default_factory=dict)
    models: list[str] = field(default_factory=list)

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
    laws = []
    for name in dict.fromkeys(run.law for run in config.runs.values()):
        code = law_code(config, name, inputs)
        laws.append(f"{name}:{library.entry(code, memory=code.written)}")
    motion, turns = motion_code(config, inputs, loaded.folder)
    plant = library.entry(plant_code(config, inputs))
    text = f"{{plant:{plant},laws:{{{','.join(laws)}}},motion:{library.entry(motion)}}}"
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
