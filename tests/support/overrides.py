"""Overrides as text: quantities, and a slow motion of a plant that nothing holds."""

from tendonrepro.configuration.load import load_config

PLAIN_ARM = "manipulator=plain_arm.yaml"


def on_plain_arm(experiment, *overrides):
    """Configuration of an experiment with the plain arm; the comparison has its own motion too."""
    if experiment == "compare":
        return load_config("plain", "compare", overrides=overrides)
    return load_config(None, experiment, overrides=(PLAIN_ARM, *overrides))


def quantity(value, unit):
    return f"{{value: {value}, unit: '{unit}', source: 'assumed: test'}}"


def one_stroke(period):
    """One period, in s, of a raised cosine: 5 degrees of joint 2 and 20 degrees of joint 3."""
    return (
        f"reference={{kind: raised_cosine, amplitude: {quantity([5, 20], 'deg')}, "
        f"period: {quantity(period, 's')}, periods: {quantity(1, '1')}}}"
    )


# Ideal encoder and viscous friction only: no dead band, no jump of H.
SMOOTH = (
    "manipulator.encoders.joint.resolution=0",
    *(f"manipulator.friction.{part}.coulomb=[0, 0, 0]" for part in ("link", "winch")),
)
