"""The interpretations of the paper that pictures and tables show, and what a reader calls them."""

from __future__ import annotations

from tendonrepro.configuration.models.control import unloaded_run
from tendonrepro.configuration.models.readings import PRINTED

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


def run_in_words(run: str) -> str:
    """What a reader calls a run.

    Examples
    --------
    >>> run_in_words("controller_1_payload"), run_in_words("my_law")
    ('Controller 1 with payload', 'My law')
    """
    words = (unloaded_run(run) or run).replace("_", " ").capitalize()
    return f"{words} with payload" if unloaded_run(run) else words


CHOICES = ("motion", "starts", "reference_acceleration", "run_friction")
"""Axes of readings that change no equation: motion, starts and friction of a run, which are not published."""

EVERY_RUN = "starts on its reference, gets the reference's acceleration, and has the same friction"
"""What every run does by the default of each of `CHOICES` but the motion, which is drawn with its plant."""


def is_choice(reading: str) -> bool:
    """Whether a reading changes some of `CHOICES` and nothing else."""
    return all(setting.partition("=")[0] in CHOICES for setting in reading.split("+"))
