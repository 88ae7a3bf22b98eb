"""Gains, control laws and readings of a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from tendonrepro.configuration.quantity import Moving, Physical, Scalar, nonneg, positive
from tendonrepro.configuration.strict_model import Identifier, Mistakes, Model

RUNS = FIRST, SECOND, THIRD, LOADED = ("controller_1", "controller_2", "controller_3", "controller_1_payload")
"""Runs of the comparison: the paper's controllers, and the first of them with payload."""

PAYLOAD = "_payload"
"""End of the name of a run with payload."""


def unloaded_run(name: str) -> str:
    """Name of the run that one repeats with payload; empty where it repeats none."""
    return name.removesuffix(PAYLOAD) if name.endswith(PAYLOAD) else ""


def run_in_words(run: str) -> str:
    """What a reader calls a run.

    Examples
    --------
    >>> run_in_words("controller_1_payload"), run_in_words("my_law")
    ('Controller 1 with payload', 'My law')
    """
    words = (unloaded_run(run) or run).replace("_", " ").capitalize()
    return f"{words} with payload" if unloaded_run(run) else words


ALPHA = (FIRST, LOADED)
TERMINAL = (FIRST, SECOND, LOADED)  # runs whose surface holds phi

FILTERED = ("low_pass", "acceleration", "estimate")
"""Values of readings that need a cutoff."""


class Gains(Model):
    """Gains of the control laws, one entry per moving joint."""

    M_bar: Annotated[Moving, positive("kg m2", "constant inertia of Eq. (6)")]
    lam: Annotated[Moving, positive("s-1", "reaching gain of Eq. (14)")]
    b: Annotated[Moving, positive("1", "exponent of Eq. (12)", below=1.0)]
    eta: Annotated[Moving, positive("1", "surface gain of Eq. (11)")]
    Delta: Annotated[Moving, positive("rad", "error at which Eq. (12) changes")]
    alpha: Annotated[Moving, nonneg("1", "weight of the older estimate, Eq. (15)", at_most=1.0)]
    beta: Annotated[Moving, positive("s-1", "surface gain of Controller 3")]
    K_d: Annotated[Moving, positive("s-1", "rate gain of Eq. (9)")] | None = None
    K_p: Annotated[Moving, positive("s-2", "error gain of Eq. (9)")] | None = None


PRINTED_LAWS = {
    FIRST: ("ntsm", "alpha_tde"),
    SECOND: ("ntsm", "tde"),
    THIRD: ("tsm", "tde"),
}
"""Surface and estimator of the paper's controllers, section 5.4; under their names nothing else runs."""


class LawChoice(Model):
    """A control law: a sliding surface, or plain PD, and an estimator."""

    surface: Literal["ntsm", "tsm", "pd"]
    estimator: Literal["alpha_tde", "tde"]


class At(NamedTuple):
    """Place of a reading in the paper, and runs it changes; `only` is for alternatives that change others."""

    place: str
    runs: tuple[str, ...] = RUNS
    only: Mapping[str, tuple[str, ...]] = {}


class Readings(Model):
    """How the paper's text is read where there is more than one way; the first value is printed.

    The order is that of settings in a reading's name. A new reading has the printed value as its default.
    """

    phi_negative: Annotated[Literal["odd", "even"], At("Eq. (12)", TERMINAL)]
    """Whether the polynomial of φ is odd, or even in its square as printed, for negative errors."""

    phi_branch: Annotated[Literal["printed", "power"], At("Eq. (12)", TERMINAL)]
    """Whether φ is the polynomial near zero, or the power everywhere."""

    weights: Annotated[Literal["interpolating", "extrapolating", "swapped"], At("Eq. (15)", ALPHA)]
    """Whether the two delayed estimates weigh (1−α, α), (1+α, −α) or (α, 1−α)."""

    differencing: Annotated[Literal["lagging", "centred"], At("Eq. (16)")]
    """Whether the second difference lags its label by one period or is centred on it."""

    gain_unit: Annotated[
        Literal["radian", "phi_in_degrees", "law_in_degrees"],
        At("Section 5.3", only={"phi_in_degrees": TERMINAL}),
    ]
    """Whether gains mean radians, or degrees inside φ, or degrees in the whole law."""

    Delta_unit: Annotated[Literal["rad", "deg"], At("Section 5.3", TERMINAL)] = "rad"
    """Whether Δ, printed without a unit, is in rad or in deg; gains in degrees have it in degrees."""

    eta_in_controller_2: Annotated[Literal["kept", "dropped"], At("Section 5.3", (SECOND,))]
    """Whether Controller 2 keeps the η that its printed law lacks."""

    torque_coordinates: Annotated[Literal["joint", "winch", "motor_shaft"], At("Eqs. (3), (17)")]
    """Whether the law's torque is of the joints, the winches or the motor shafts."""

    torque_unit: Annotated[Literal["newton_metre", "percent_of_rated", "volt"], At("Section 5.3")]
    """Whether the law's torque, and so M̄, is in N m, in percent of the rated torque or in volts."""

    stored_torque: Annotated[Literal["commanded", "applied"], At("Eqs. (8), (15)")]
    """Whether the estimator remembers the torque it commanded, or the one the drive put out."""

    delay_time: Annotated[Literal["one_period", "two_periods", "four_periods"], At("Remark 2")]
    """How many sampling periods the delay time L is."""

    estimate_filter: Annotated[Literal["none", "acceleration", "estimate"], At("Eqs. (8), (15), (16)")]
    """Whether the acceleration, or the whole estimate, is low-pass filtered at the drawn cutoff."""

    feedback: Annotated[Literal["joint", "motor"], At("Section 5.1")]
    """Whether the law looks at the joints' encoders, or at S times the motors'."""

    reference_acceleration: Annotated[Literal["fed_forward", "absent", "late"], At("Eq. (18)")] = (
        "fed_forward"
    )
    """Whether the law gets the reference's acceleration, or none, or its rates late by the drawn lag."""

    start: Annotated[Literal["filled", "cold"], At("Eqs. (8), (15)")]
    """Whether the delay lines hold the state at rest or zeros before the first sample."""

    error_rate: Annotated[
        Literal["backward_difference", "low_pass", "difference_of_error"],
        At("Eqs. (11), (18)"),
        Field(
            description="Whether the error's rate is the desired one less a plain difference of the encoder, "
            "that low-pass filtered at the drawn cutoff, or the difference of the error."
        ),
    ]


class Control(Model):
    """Gains, laws and readings of the compared controllers."""

    gains: Gains
    laws: Annotated[dict[Identifier, LawChoice], Field(min_length=1)]
    """the laws that runs may name"""
    readings: Readings
    filter_cutoff: (
        Annotated[Scalar, Physical("Hz", "cutoff of the readings' low-pass filters", at_least=1e-9)] | None
    ) = None
    reference_lag: (
        Annotated[Scalar, nonneg("s", "time constant of the reading that has the reference's rates late")]
        | None
    ) = None

    def _mistakes(self) -> Mistakes:
        for name, law in self.laws.items():
            chosen = law.surface, law.estimator
            printed = PRINTED_LAWS.get(name, chosen)
            if chosen != printed:
                paper = "surface {} and estimator {}".format(*printed)
                yield ("laws", name), f"is the paper's, {paper}: give yours another name"
            for gain in ("K_d", "K_p"):
                if law.surface == "pd" and getattr(self.gains, gain) is None:
                    yield ("gains",), f"missing key {gain!r}, which the law {name!r} needs"
        for reading in ("error_rate", "estimate_filter"):
            value = getattr(self.readings, reading)
            if value in FILTERED and self.filter_cutoff is None:
                yield (), f"missing key 'filter_cutoff', which the reading {reading}: {value} needs"
        if self.readings.reference_acceleration == "late" and self.reference_lag is None:
            yield (), "missing key 'reference_lag', which the reading reference_acceleration: late needs"

    def unread(self) -> dict[str, str]:
        """Keys that these readings leave unread, and the readings that would read them."""
        needs = {}
        if self.readings.error_rate not in FILTERED and self.readings.estimate_filter not in FILTERED:
            needs["filter_cutoff"] = "error_rate: low_pass, or estimate_filter: acceleration or estimate"
        if self.readings.reference_acceleration != "late":
            needs["reference_lag"] = "reference_acceleration: late"
        return needs
