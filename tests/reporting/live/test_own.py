"""A user's configuration runs in the page as in Python, whatever its joints, motion, readings and effects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from reporting.live.test_browser import by_python, configured, opened, same, taken_steps
from support.browser import Browser

import tendonrepro as tr
from tendonrepro.configuration.load import load_config

pytestmark = pytest.mark.slow


def quantity(value: str, unit: str) -> str:
    return f"{{value: {value}, unit: {unit}, source: 'assumed: by this test'}}"


NUMBER = '"1"'
ONCE = f"periods: {quantity('1', NUMBER)}"
GAINS = {
    "M_bar": 0.01,
    "lam": 8,
    "b": 0.9,
    "eta": 1.5,
    "Delta": 0.2,
    "alpha": 0.1,
    "beta": 2,
    "K_d": 10,
    "K_p": 16,
}
OWN = {
    "three joints": [
        "joints=[1,2,3]",
        *(f"control.gains.{name}={[value] * 3}" for name, value in GAINS.items()),
        "reference.amplitude=[10,10,10]",
        "manipulator.tendons.damping_factor=8",
    ],
    "joints in turns": [
        f"reference={{kind: raised_cosine, amplitude: {quantity('[20,25]', 'deg')}, "
        f"period: {quantity('4', 's')}, {ONCE}, turns: [[2],[3]]}}"
    ],
    "trapezes": [
        f"reference={{kind: trapezoidal, amplitude: {quantity('[1.0,0.5]', 'rad')}, "
        f"velocity: {quantity('1', 'rad s-1')}, acceleration: {quantity('2', 'rad s-2')}, "
        f"hold: {quantity('1', 's')}, {ONCE}}}"
    ],
    "readings": [
        "control.readings.torque_coordinates=winch",
        "control.readings.delay_time=two_periods",
        "control.readings.stored_torque=applied",
        "control.readings.start=cold",
        "control.readings.estimate_filter=acceleration",
        "manipulator.actuator.output_delay=1",
    ],
    "more readings": [
        "control.readings.feedback=motor",
        "control.readings.error_rate=difference_of_error",
        "control.readings.phi_negative=even",
        "control.readings.differencing=centred",
        "control.readings.gain_unit=phi_in_degrees",
    ],
    "one run": [
        f"runs={{only: {{law: tdc, payload: {quantity('0.3', 'kg')}}}}}",
    ],
    "effects": [
        "manipulator.friction.reducer_efficiency=0.8",
        "manipulator.friction.per_pulley=0.03",
        "manipulator.transmission_error.peak_to_peak=3e-4",
        "manipulator.tendons.clearance=[0,0.1,0.1]",
        "manipulator.tendons.unilateral=on",
        "manipulator.tensioner.force=20",
        f"runs.controller_2.friction_scale={quantity('1.5', NUMBER)}",
        f"runs.controller_1.start_offset={quantity('[0.02,0.01]', 'rad')}",
        f"disturbance={{kind: step, torque: {quantity('[0.2,0.1]', 'N m')}, start: {quantity('1', 's')}}}",
    ],
}


@pytest.mark.parametrize(
    ("arm", "changes"),
    [*(("plain", changes) for changes in OWN.values()), ("compare", ["manipulator.actuator.torque_noise=0"])],
    ids=[*OWN, "typical arm, its noise apart"],
)
def test_a_configuration_of_ones_own(
    browser: Browser, tmp_path: Path, arm: str, changes: Sequence[str]
) -> None:
    path, loaded = tmp_path / "own.html", load_config(arm, "compare", overrides=changes)
    tr.live(arm, path, set=changes)
    found = opened(browser, path, "#own")
    same(found, by_python(loaded, taken_steps(browser)))
    assert configured(browser).config == loaded.config
    browser.width(390)
    assert browser.run("return document.documentElement.scrollWidth") <= 390
    browser.width(1280)
    # The others are written as what they change in this one.
    opened(browser, path, "#fitted")
    assert configured(browser).config == load_config("closest", "compare").config
    assert browser.console() == []
