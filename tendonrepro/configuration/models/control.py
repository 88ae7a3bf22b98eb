"""The control laws of a configuration: gains, laws and readings of the paper's text."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tendonrepro.configuration.fields.model import Identifier, Model, Problems
from tendonrepro.configuration.fields.physical import per_moving_joint, physical
from tendonrepro.configuration.fields.quantity import Scalar, Vector

FILTERED = ("low_pass", "acceleration", "estimate")
"""Values of readings that need a cutoff."""


class Gains(Model):
    """Gains of the control laws, one entry per moving joint."""

    M_bar: Annotated[Vector, per_moving_joint("kg m2", "constant inertia of Eq. (6)", above=0.0)]
    lam: Annotated[Vector, per_moving_joint("s-1", "reaching gain of Eq. (14)", above=0.0)]
    b: Annotated[Vector, per_moving_joint("1", "exponent of Eq. (12)", above=0.0, below=1.0)]
    eta: Annotated[Vector, per_moving_joint("1", "surface gain of Eq. (11)", above=0.0)]
    Delta: Annotated[Vector, per_moving_joint("rad", "error at which Eq. (12) changes", above=0.0)]
    alpha: Annotated[
        Vector,
        per_moving_joint("1", "weight of the older estimate, Eq. (15)", at_least=0.0, at_most=1.0),
    ]
    beta: Annotated[Vector, per_moving_joint("s-1", "surface gain of Controller 3", above=0.0)]
    K_d: Annotated[Vector, per_moving_joint("s-1", "rate gain of Eq. (9)", above=0.0)] | None = None
    K_p: Annotated[Vector, per_moving_joint("s-2", "error gain of Eq. (9)", above=0.0)] | None = None


PRINTED_LAWS = {
    "controller_1": ("ntsm", "alpha_tde"),
    "controller_2": ("ntsm", "tde"),
    "controller_3": ("tsm", "tde"),
}
"""Surface and estimator of the paper's controllers, section 5.4; under their names nothing else runs."""


class LawChoice(Model):
    """A control law: a sliding surface (or plain PD) and an estimator."""

    surface: Literal["ntsm", "tsm", "pd"]
    estimator: Literal["alpha_tde", "tde"]


class Readings(Model):
    """How the paper's text is read where it can be read in more than one way."""

    phi_negative: Annotated[Literal["odd", "even"], Field(description="polynomial of Eq. (12) below zero")]
    phi_branch: Annotated[Literal["printed", "power"], Field(description="branch of Eq. (12) near zero")]
    weights: Annotated[
        Literal["interpolating", "extrapolating", "swapped"], Field(description="weights of Eq. (15)")
    ]
    differencing: Annotated[Literal["lagging", "centred"], Field(description="differences of Eq. (16)")]
    gain_unit: Annotated[
        Literal["radian", "phi_in_degrees", "law_in_degrees"], Field(description="angle unit of the gains")
    ]
    eta_in_controller_2: Annotated[Literal["kept", "dropped"], Field(description="eta in Controller 2's law")]
    torque_coordinates: Annotated[
        Literal["joint", "winch", "motor_shaft"], Field(description="coordinates of the law's torque")
    ]
    error_rate: Annotated[
        Literal["backward_difference", "low_pass", "difference_of_error"],
        Field(description="how the error rate is obtained"),
    ]
    stored_torque: Annotated[
        Literal["commanded", "applied"], Field(description="torque that the estimator remembers")
    ]
    delay_time: Annotated[
        Literal["one_period", "two_periods", "four_periods"], Field(description="L in sampling periods")
    ]
    feedback: Annotated[Literal["joint", "motor"], Field(description="encoders that the law looks at")]
    estimate_filter: Annotated[
        Literal["none", "acceleration", "estimate"],
        Field(description="what the estimator passes through a low-pass filter"),
    ]
    torque_unit: Annotated[
        Literal["newton_metre", "percent_of_rated", "volt"], Field(description="unit of the law's torque")
    ]
    start: Annotated[
        Literal["filled", "cold"], Field(description="history of the law before the first sample")
    ]


class Control(Model):
    """Gains, laws and readings of the compared controllers."""

    gains: Gains
    laws: Annotated[
        dict[Identifier, LawChoice], Field(min_length=1, description="the laws that runs may name")
    ]
    readings: Readings
    filter_cutoff: (
        Annotated[Scalar, physical("Hz", "cutoff of the readings' low-pass filters", at_least=1e-9)] | None
    ) = None

    @model_validator(mode="after")
    def _check_needs(self) -> Self:
        with Problems() as problems:
            for name, law in self.laws.items():
                printed = PRINTED_LAWS.get(name, held := (law.surface, law.estimator))
                if held != printed:
                    paper = "surface {} and estimator {}".format(*printed)
                    problems.add(("laws", name), f"is the paper's, {paper}: give yours another name")
            plain = [name for name, law in self.laws.items() if law.surface == "pd"]
            for gain in ("K_d", "K_p"):
                if plain and getattr(self.gains, gain) is None:
                    problems.add(("gains",), f"missing key {gain!r}, which the law {plain[0]!r} needs")
            for reading in ("error_rate", "estimate_filter"):
                if (value := getattr(self.readings, reading)) in FILTERED and self.filter_cutoff is None:
                    problems.add(
                        (), f"missing key 'filter_cutoff', which the reading {reading}: {value} needs"
                    )
        return self
