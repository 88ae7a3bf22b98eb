"""The numbers of docs/theory.md and docs/slips.md, computed again."""

from __future__ import annotations

import numpy as np
import pytest
from support.pages import CONTROLLERS, NEEDS_DOCS, cells_of, stated

from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.experiments.loops import build_law
from tendonrepro.experiments.rig import build_plant
from tendonrepro.physics.control import error_ratio, phi_slope
from tendonrepro.physics.linear_loop import decay_rate

pytestmark = NEEDS_DOCS
EXTRAPOLATING = "control.readings.weights=extrapolating"
APPLIED = "control.readings.stored_torque=applied"


@pytest.mark.parametrize(
    ("row", "settings", "delay"),
    [
        ("extrapolating weights", ["weights=extrapolating"], 0),
        ("weights swapped, (α, 1 − α)", ["weights=swapped"], 0),
        ("delay time of two or four periods", ["delay_time=four_periods"], 0),
        ("applied torque stored, one sample of output delay", ["stored_torque=applied"], 1),
        ("estimate through a low-pass of f periods, 1.6 at 77 Hz", ["estimate_filter=estimate"], 0),
    ],
)
def test_ratios_of_other_readings_in_the_theory(row: str, settings: list[str], delay: int) -> None:
    cells = cells_of("docs/theory.md", f"… {row}")
    config = load_config("plain", "compare", overrides=[f"control.readings.{one}" for one in settings]).config
    assert isinstance(config, CompareConfig)
    first, second = (build_law(config, name) for name in CONTROLLERS[:2])
    assert cells[1:] == [f"{ratio:.2f}" for ratio in error_ratio(first, second, 1e-3, delay)]


def test_a_delay_changes_little_unless_the_applied_torque_is_stored() -> None:
    for name in CONTROLLERS:
        assert [slowest(name, delay=delay) for delay in (0, 1, 2)] == pytest.approx([2.0] * 3, abs=0.1)
    rates = [slowest(name, APPLIED, delay=1) for name in CONTROLLERS]
    assert rates[0] > 1.5
    assert rates[1:] == pytest.approx([0.13] * 2, abs=0.006)
    assert slowest("controller_1", APPLIED, EXTRAPOLATING, delay=1) < 0.0


def slowest(name: str, *overrides: str, delay: int) -> float:
    """Slowest decay of a law at the start posture, s⁻¹."""
    config = load_config("plain", "compare", overrides=overrides).config
    assert isinstance(config, CompareConfig)
    return decay_rate([np.zeros(2)], build_plant(config, 0.0), build_law(config, name), delay=delay)


def test_the_references_own_error() -> None:
    """Closed forms of the error equation, of the slope of φ at zero."""
    config, theory = load_config("plain", "compare").config, "docs/theory.md"
    assert isinstance(config, CompareConfig)
    law = build_law(config, "controller_2")
    lam, k = float(law.lam[0]), float(law.eta[0] * phi_slope(0.0, law, 0))
    slow, step, offset = 1.0 / (lam * k), 1.0 / (lam * k), (lam + k) / (lam * k)
    left = [100.0 * (lam * np.exp(-k * t) - k * np.exp(-lam * t)) / (lam - k) for t in (1.0, 2.0)]
    for pattern, found, half in (
        (r"λk is ([\d.]+) s⁻² and", [lam * k], 0.05),
        (r"and 1/k is ([\d.]+) s", [1.0 / k], 0.005),
        (r"\| ?e ≈ a/\(λk\) ?\| ?([\d.]+)° for 0.01", [np.rad2deg(0.01 * slow)], 0.0005),
        (r"\| ?([\d.]+) s Δv", [step], 0.0006),
        (r"\| ?([\d.]+) s e₀", [offset], 0.005),
        (r"an offset (\d+) % is left after one second and (\d+) % after two", left, 0.5),
    ):
        assert stated(pattern, theory) == pytest.approx(found, abs=half)
