"""Readings of the paper, one named axis for each ambiguous place; what-ifs; what a reader calls them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar, get_args

import numpy as np

from tendonrepro.configuration.models.control import RUNS, SECOND, At, Readings
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.reference import Strokes
from tendonrepro.configuration.published import COMPARED
from tendonrepro.configuration.quantity import Moving, Scalar, Vector
from tendonrepro.configuration.strict_model import Model
from tendonrepro.errors import UsageError

PRINTED = "printed"
"""Name of the reading that leaves every axis as printed."""

ERROR_RATES = ("backward_difference", "low_pass")
"""Error rates in the order that a draw numbers them."""

OFFSETS: Mapping[tuple[str, int], str] = {
    (run, joint): f"offset_{run}_joint_{joint}" for run in RUNS for joint in COMPARED
}
"""Rows of the box for where a run starts beside its reference."""
FRICTIONS: Mapping[str, str] = {run: f"friction_{run}" for run in RUNS[1:]}
"""Rows of the box for the friction of a run over that of the first."""
UNDER_READINGS = ("reference_lag", *OFFSETS.values(), *FRICTIONS.values())
"""Rows of the box that act under some readings alone, the last ones."""

_LEAST_ANGLE = np.radians(0.5)
"""Angle from hanging or upright, rad, up to which a link may wait before the start."""
_SOURCE = "assumed: the reading that is being run"
_OUTPUT_DELAY = "manipulator.actuator.output_delay"
_ENCODER = "manipulator.encoders.joint.resolution"
_QUANTITIES = {  # unit and dotted keys of an axis whose values are numbers
    "output_delay": ("1", _OUTPUT_DELAY),
    "encoder": ("deg", _ENCODER),
    "torque_step": ("N m", "manipulator.actuator.torque_resolution"),
    "sampling_period": ("ms", "sampling_period", "solver.max_step"),
}
_M = TypeVar("_M", bound=Model)


class ReadingAxis(NamedTuple):
    """One place that can be read in more than one way; `printed` is assumed where the paper is silent."""

    name: str
    printed: str
    alternatives: Sequence[str]
    at: At
    about: str

    @property
    def affects(self) -> dict[str, tuple[str, ...]]:
        """Runs that each alternative changes."""
        return {value: self.at.only.get(value, self.at.runs) for value in self.alternatives}


class Reading(NamedTuple):
    """A choice on every axis: axis and value in the order of `AXES`, printed values left out.

    Its name is ``printed``, or ``axis=value`` joined by ``+``.
    """

    name: str
    settings: tuple[tuple[str, str], ...]


def _held() -> dict[str, ReadingAxis]:
    axes = {}
    for name, field in Readings.model_fields.items():
        printed, *others = get_args(field.annotation)
        (at,) = (item for item in field.metadata if isinstance(item, At))
        axes[name] = ReadingAxis(name, printed, others, at, field.description or "")
    return axes


_HARDWARE = ReadingAxis(
    "hardware", "printed", ["drawn"], At("Section 5.1"),
    "Whether encoder, output delay and filter are as printed or as the draw has them.",
)  # fmt: skip
_INSTRUMENTS = (
    ReadingAxis("output_delay", "0", ["1", "2"], At("Eq. (17)"),
        "Samples between a command and its torque; the equations hold none."),
    ReadingAxis("encoder", "0.022", ["0.045", "0.088", "ideal"], At("Section 5.1"),
        "Count of the joint encoders in degrees; parts of the named family give 0.045 or 0.088."),
    ReadingAxis("torque_step", "drawn", ["none", "0.0032", "0.016"], At("Section 5.1"),
        "Step of the drives' torque at the winch in N m; 16-bit and 11-bit inputs give 0.0032 and 0.016."),
    ReadingAxis("tensioner", "negative", ["distal_only", "alternating", "absent"], At("Section 2.2"),
        "On which side tendon 4 passes the joints; absent as in Eqs. (3) to (5)."),
    ReadingAxis("motion", "drawn", ["ramp"], At("Section 5.3"),
        "Whether the motion is the draw's own, or straight lines whose velocity steps at each corner."),
    ReadingAxis("starts", "together", ["apart"], At("Fig. 14"),
        "Whether each run starts on its reference, or up to 2 degrees beside it."),
    ReadingAxis("run_friction", "alike", ["drawn"], At("Section 5.3", RUNS[1:]),
        "Whether friction is the same in all runs, or differs from the first run's by the drawn factors."),
)  # fmt: skip
_LAW = _held()
_RATE = _LAW.pop("error_rate")  # what is said of it replaces what the draw's hardware has
AXES: Mapping[str, ReadingAxis] = _LAW | {axis.name: axis for axis in (_HARDWARE, _RATE, *_INSTRUMENTS)}
"""The axes of readings, by name."""

_WHAT_IFS = (
    ReadingAxis("sampling_period", "1ms", ["0.5ms", "2ms"], At("Remark 2", (SECOND,)), "L of the law."),
    ReadingAxis("M_bar", "printed", ["halved"], At("Section 4.2", (SECOND,)), "M_bar of the law."),
)
_EVERY_AXIS: Mapping[str, ReadingAxis] = {**AXES, **{axis.name: axis for axis in _WHAT_IFS}}


def reading(settings: Mapping[str, str]) -> Reading:
    """Make a reading of values by axis; a UsageError for unknown ones."""
    for name, value in settings.items():
        axis = _EVERY_AXIS.get(name)
        if axis is None:
            hint = f"Axes: {', '.join(_EVERY_AXIS)}"
            raise UsageError(f"no axis of readings is called {name!r}", hint=hint)
        if value not in (axis.printed, *axis.alternatives):
            raise UsageError(f"{name} is {axis.printed}, {' or '.join(axis.alternatives)}, not {value!r}")
    chosen = {name: settings.get(name, axis.printed) for name, axis in _EVERY_AXIS.items()}
    kept = tuple((name, value) for name, value in chosen.items() if value != _EVERY_AXIS[name].printed)
    return Reading("+".join(f"{name}={value}" for name, value in kept) or PRINTED, kept)


def parse_reading(text: str) -> Reading:
    """Read the name of a reading, or a UsageError."""
    if text == PRINTED:
        return reading({})
    settings = [[part.strip() for part in setting.split("=")] for setting in text.split("+")]
    if any(len(setting) != 2 for setting in settings):
        message = f"a reading is {PRINTED!r} or axis=value, found {text!r}"
        raise UsageError(message, hint=f"Axes: {', '.join(_EVERY_AXIS)}")
    chosen = dict(settings)
    if len(chosen) < len(settings):
        raise UsageError(f"the reading {text!r} sets an axis twice")
    return reading(chosen)


def named_readings(text: str) -> tuple[Reading, ...]:
    """Read names with commas between; a UsageError when one is a variation."""
    found = tuple(dict.fromkeys(parse_reading(name.strip()) for name in text.split(",")))
    for held in found:
        if any(axis not in AXES for axis, _ in held.settings):
            raise UsageError(f"{held.name} is a variation, not a reading", where="--readings")
    return found


def default_readings(pairs: Sequence[Sequence[str]]) -> tuple[Reading, ...]:
    """As printed, each alternative alone, and pairs."""
    single = [reading({axis.name: value}) for axis in AXES.values() for value in axis.alternatives]
    together = [parse_reading("+".join(pair)) for pair in pairs]
    return tuple(dict.fromkeys([reading({}), *single, *together]))


VARIATIONS: tuple[Reading, ...] = (
    *(reading({axis.name: value}) for axis in _WHAT_IFS for value in axis.alternatives),
    *(reading({"sampling_period": value, "encoder": "ideal"}) for value in ("0.5ms", "2ms")),
)
"""What-ifs that are no readings, for Controller 2: sampling period, also without counts, and M_bar."""


def case_of(reading_: Reading, run: str) -> Reading:
    """What of a reading changes one run; runs of equal cases are one simulation."""
    return reading(
        {name: value for name, value in reading_.settings if run in _EVERY_AXIS[name].affects[value]}
    )


def under(reading_: Reading, config: CompareConfig, draw: Mapping[str, float]) -> CompareConfig:
    """Apply a reading or a variation, without validation, to a configuration as printed.

    `draw` holds the value of every row of the box, SI, for ``hardware=drawn``.
    """
    for name, value in reading_.settings:
        for path, new in _changes(name, value, config, draw).items():
            config = replaced(config, path, new)
    return config


def as_printed(config: CompareConfig) -> CompareConfig:
    """Set the axes that the configuration itself holds to their printed values."""
    names = (*type(config.control.readings).model_fields, "output_delay", "encoder")
    return under(Reading(PRINTED, tuple((name, AXES[name].printed) for name in names)), config, {})


def replaced(model: _M, path: str, value: object) -> _M:
    """Copy a model with the field at a dotted path changed."""
    first, _, rest = path.partition(".")
    return model.model_copy(update={first: replaced(getattr(model, first), rest, value) if rest else value})


def _scalar(value: float, unit: str, row: str = "") -> Scalar:
    return Scalar.model_construct(value=value, unit=unit, source=of_row(row) if row else _SOURCE)


def _angles(values: Sequence[float], row: str) -> Vector:
    return Moving.model_construct(value=tuple(values), unit="rad", source=of_row(row))


def of_row(row: str) -> str:
    """Source of a value that is drawn, of a row of the box."""
    return f"assumed: draw from the box, {row}"


def _changes(name: str, value: str, config: CompareConfig, draw: Mapping[str, float]) -> dict[str, object]:
    """New values by dotted key."""
    if name in _QUANTITIES:
        unit, *paths = _QUANTITIES[name]
        number = 0.0 if value in ("ideal", "none") else float(value.removesuffix("ms"))
        return dict.fromkeys(paths, _scalar(number, unit))
    if name in _OTHERS:
        return _OTHERS[name](value, config, draw)
    return {f"control.readings.{name}": value}


def _hardware(_: str, __: CompareConfig, draw: Mapping[str, float]) -> dict[str, object]:
    return {
        "control.readings.error_rate": ERROR_RATES[int(draw["error_rate"])],
        _OUTPUT_DELAY: _scalar(float(int(draw["output_delay"])), "1"),
        _ENCODER: _scalar(draw["encoder_count"], "rad"),
    }


def _tensioner(value: str, _: CompareConfig, __: Mapping[str, float]) -> dict[str, object]:
    if value == "absent":
        return {"manipulator.tensioner.force": _scalar(0.0, "N")}
    return {"manipulator.tensioner.side": value}


def _inertia(_: str, config: CompareConfig, __: Mapping[str, float]) -> dict[str, object]:
    M_bar = config.control.gains.M_bar
    half = {"value": tuple(entry / 2.0 for entry in M_bar.value), "source": _SOURCE}
    return {"control.gains.M_bar": M_bar.model_copy(update=half)}


def _ramp(_: str, __: CompareConfig, draw: Mapping[str, float]) -> dict[str, object]:
    """Two periods of straight strokes of both joints, with the draw's amplitude and times."""
    amplitude = _angles([draw["amplitude"]] * len(COMPARED), "amplitude")
    rise, hold = (_scalar(round(draw[name], 2), "s", name) for name in ("rise", "hold"))
    periods = _scalar(2.0, "1")
    ramp = Strokes.model_construct(
        kind="ramp", amplitude=amplitude, rise=rise, hold=hold, periods=periods, turns=None
    )
    return {"reference": ramp}


def _apart(_: str, config: CompareConfig, draw: Mapping[str, float]) -> dict[str, object]:
    """Arms wait beside the reference, as far as their links stay in the half-plane."""
    posture = np.cumsum(config.posture.si)[-len(COMPARED) :]  # of the links, from hanging
    runs = dict(config.runs)
    for run in RUNS:
        offsets = np.cumsum([draw[OFFSETS[run, joint]] for joint in COMPARED])
        links = np.clip(posture + offsets, _LEAST_ANGLE, np.pi - _LEAST_ANGLE) - posture
        offset = _angles(np.diff(links, prepend=0.0).tolist(), f"offset_{run}")
        runs[run] = runs[run].model_copy(update={"start_offset": offset})
    return {"runs": runs}


def _run_friction(_: str, config: CompareConfig, draw: Mapping[str, float]) -> dict[str, object]:
    runs = dict(config.runs)
    for run, row in FRICTIONS.items():
        runs[run] = runs[run].model_copy(update={"friction_scale": _scalar(draw[row], "1", row)})
    return {"runs": runs}


_OTHERS: Mapping[str, Callable[[str, CompareConfig, Mapping[str, float]], dict[str, object]]] = {
    "hardware": _hardware,
    "tensioner": _tensioner,
    "M_bar": _inertia,
    "motion": _ramp,
    "starts": _apart,
    "run_friction": _run_friction,
}
"""What axes change that are neither a number nor a key of the law's readings."""

BOTH = "weights=extrapolating+Delta_unit=deg"
"""Reading under which the published order comes out."""
STEPS = "Delta_unit=deg+stored_torque=applied+torque_step=0.016"
"""Reading with Eq. (15) as printed under which it comes out on some plants."""
STARTS_APART = "starts=apart"
"""Part of the name of a reading under which runs do not start on their reference."""

AS_PUBLISHED = {
    "printed": "As published",
    "encoder=ideal": "Ideal encoders",
    "hardware=drawn": "Encoder, delay and filter varied",
    "feedback=motor": "Motor encoders in the loop, errors of motors",
    "Delta_unit=deg": "Δ in degrees",
    "stored_torque=applied": "Estimator stores the applied torque",
    "stored_torque=applied+output_delay=1": "… which acts one sample late",
    "stored_torque=applied+torque_step=0.016": "Estimator stores a torque in steps",
    STEPS: "… with Δ in degrees",
    "torque_unit=volt": "Torque in volts",
}
BEYOND = {
    "reference_acceleration=late": "Acceleration fed forward late",
    "reference_acceleration=absent": "Acceleration not fed forward",
    "motion=ramp": "Straight ramps, no acceleration to feed forward",
    "starts=apart": "Runs start up to 2° from their reference",
    "reference_acceleration=absent+starts=apart": "… and acceleration not fed forward",
    "motion=ramp+starts=apart": "… on straight ramps",
    "Delta_unit=deg+motion=ramp+starts=apart": "… on straight ramps, with Δ in degrees",
    "feedback=motor+motion=ramp+starts=apart": "… on straight ramps, errors of motors",
    "run_friction=drawn": "Friction 0.7 to 1.4 times from run to run",
}
CHANGED = {
    "weights=extrapolating": "Weights (1 + α, −α)",
    "weights=extrapolating+gain_unit=phi_in_degrees": "… with φ in degrees",
    BOTH: "… with Δ in degrees",
    "weights=extrapolating+Delta_unit=deg+feedback=motor": "… with Δ in degrees, errors of motors",
    "weights=extrapolating+Delta_unit=deg+motion=ramp": "… with Δ in degrees, on straight ramps",
    "weights=extrapolating+Delta_unit=deg+reference_acceleration=absent": "… with Δ in degrees, acceleration "
    "not fed forward",
    "weights=extrapolating+motion=ramp+starts=apart": "… on straight ramps, with runs that start apart",
}
GROUPS = {
    "Equations as published": AS_PUBLISHED,
    "Equations as published, other references and runs": BEYOND,
    "Equations changed": CHANGED,
}
"""Readings of the ensemble that the picture and the table of findings show, and what a reader calls them.

Outside the second group every run starts on its reference and gets its acceleration, except in the last row,
and friction is the same in every run.
"""
KEPT = AS_PUBLISHED | BEYOND
"""Those that keep every equation as published."""
SHOWN = KEPT | CHANGED
"""All of them; their name among readings is ``shown``."""

SETTINGS = {
    "phi_negative=even": "φ even for negative errors",
    "phi_branch=power": "φ the power everywhere",
    "weights=extrapolating": "weights 1 + α and −α",
    "weights=swapped": "weights α and 1 − α",
    "differencing=centred": "differences centred",
    "gain_unit=phi_in_degrees": "φ in degrees",
    "gain_unit=law_in_degrees": "all gains in degrees",
    "Delta_unit=deg": "Δ in degrees",
    "eta_in_controller_2=dropped": "Controller 2 without η",
    "torque_coordinates=winch": "torque at the winches",
    "torque_coordinates=motor_shaft": "torque at the motor shafts",
    "torque_unit=percent_of_rated": "torque in percent of rated",
    "torque_unit=volt": "torque in volts",
    "stored_torque=applied": "applied torque stored",
    "torque_step=0.016": "torque in coarse steps",
    "torque_step=0.0032": "torque in fine steps",
    "torque_step=none": "torque without steps",
    "delay_time=two_periods": "L is two periods",
    "delay_time=four_periods": "L is four periods",
    "estimate_filter=acceleration": "acceleration filtered",
    "estimate_filter=estimate": "estimate filtered",
    "feedback=motor": "motor encoders in the loop, errors of motors",
    "reference_acceleration=absent": "acceleration not fed forward",
    "reference_acceleration=late": "acceleration fed forward late",
    "start=cold": "estimator starts empty",
    "error_rate=low_pass": "velocity filtered",
    "error_rate=difference_of_error": "error differenced",
    "hardware=drawn": "encoder, delay, filter varied",
    "encoder=ideal": "ideal encoders",
    "motion=ramp": "straight ramps",
    "starts=apart": "runs start apart",
    "run_friction=drawn": "friction differs between runs",
}
"""What a reader calls the settings of a reading; others keep their names."""


def in_words(reading: str) -> str:
    """What a reader calls a reading, by its name.

    Examples
    --------
    >>> in_words("printed"), in_words("Delta_unit=deg+encoder=0.045")
    ('as published', 'Δ in degrees, encoder=0.045')
    """
    if reading == PRINTED:
        return "as published"
    return ", ".join(SETTINGS.get(setting, setting) for setting in reading.split("+"))


CHOICES = ("motion", "starts", "reference_acceleration", "run_friction")
"""Axes of readings that change no equation: motion, starts and friction of a run, which are not published."""

EVERY_RUN = "starts on its reference, gets the reference's acceleration, and has the same friction"
"""What every run does by the default of each of `CHOICES` but the motion, which is drawn with its plant."""


def is_choice(reading: str) -> bool:
    """Whether a reading changes some of `CHOICES` and nothing else."""
    return all(setting.partition("=")[0] in CHOICES for setting in reading.split("+"))
