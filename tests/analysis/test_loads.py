"""How a load becomes an error: the limit of slow loads, and a sine on the whole arm in time."""

from dataclasses import replace

import numpy as np
import pytest
from support.overrides import SMOOTH

from tendonrepro.analysis.analysis import first_views
from tendonrepro.analysis.loads import load_to_error, loads
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops, run_views
from tendonrepro.physics.disturbance import sine_disturbance
from tendonrepro.simulation.loop import DesiredMotion
from tendonrepro.simulation.stepper import simulate

LOADED = load_config(None, "compare", overrides=(*SMOOTH, "manipulator.actuator.torque_limit=[99, 99, 99]"))
VIEWS = first_views(run_views(LOADED.config))
L, STILL = 1e-3, np.zeros((4001, 2))


def moving(hertz: float) -> np.ndarray:
    return np.stack([np.sin(2 * np.pi * hertz * L * np.arange(8000))] * 2, axis=1)


def test_of_slow_loads_the_ratio_is_that_of_the_ages_and_slopes():
    found = loads(VIEWS, np.zeros(2), moving(0.5))
    one, two, three = (found.error[f"controller_{k}"][:, 0] for k in (1, 2, 3))
    assert one / two == pytest.approx([1.1, 1.2], rel=1e-3)
    # lambda beta over lambda eta gamma_1, with gamma_1 = (2 - b) Delta^(b - 1).
    assert two / three == pytest.approx(2.0 / (1.5 * 1.1 * 0.2**-0.1), rel=1e-3)
    assert found.motion_hz == pytest.approx(0.5, abs=0.2)
    assert 5.0 < found.mode_hz < 20.0


@pytest.mark.parametrize("hertz", [2.0, 10.0, 40.0])
def test_a_sine_on_the_whole_arm_leaves_that_error(hertz: float):
    """A small load, so that the arm stays linear; after two seconds nothing is left of the start."""
    loop = dict(build_loops(LOADED.config, LOADED.folder))["controller_1"]
    reference = DesiredMotion(L * np.arange(len(STILL)), STILL, STILL, STILL)
    plant = loop.plant._replace(disturbance=sine_disturbance(np.array([0.0, 1e-4]), hertz))
    run = simulate(replace(loop, plant=plant, reference=reference))
    late = slice(2000, 4000)
    angle = 2.0 * np.pi * hertz * run["time"][late]
    amplitude = np.hypot(*(2.0 * np.mean(run["e"][late, 1] * wave(angle)) for wave in (np.sin, np.cos)))
    expected = load_to_error(VIEWS["controller_1"], np.zeros(2), np.array([2.0 * np.pi * hertz * L]))
    assert amplitude / 1e-4 == pytest.approx(abs(expected[1, 0]), rel=0.01)


def test_a_loop_that_grows_has_no_error_per_load():
    view = VIEWS["controller_1"]
    growing = view._replace(law=view.law._replace(M_bar=30.0 * view.law.M_bar))
    assert load_to_error(growing, np.zeros(2), np.array([0.1])) is None
