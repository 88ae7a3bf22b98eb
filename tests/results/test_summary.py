"""Sizes, rankings and tensions of known runs; statistics of a trace are those of the batch stepper."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.synthetic import make_compare_file

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import all_loops
from tendonrepro.results.paper import fitted_under, with_what_they_are
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import (
    NOISE,
    loaded_runs,
    noise_covariance,
    ranking,
    saturated,
    sizes_deg,
    statistics,
    tension_sizes,
    tensions,
    with_noise,
)
from tendonrepro.simulation.batch import simulate_batch

Array = NDArray[np.float64]


def with_error(trace: Trace, e: Array) -> Trace:
    return dataclasses.replace(trace, variables={**trace.variables, "e": e})


def constant_errors(degrees: dict[str, tuple[float, float]]) -> TraceFile:
    """A file whose runs have a constant error on joints 2 and 3."""
    file = make_compare_file(runs=list(degrees))
    runs = {
        name: with_error(trace, np.deg2rad(np.tile(degrees[name], (len(trace.time), 1))))
        for name, trace in file.runs.items()
    }
    return dataclasses.replace(file, runs=runs)


class TestSizes:
    def test_missing_samples_are_left_out_one_by_one(self) -> None:
        e = np.deg2rad([[1.0, math.nan], [-3.0, 2.0], [math.nan, math.nan]])
        sizes = sizes_deg(e)
        assert sizes["mae_deg"] == pytest.approx([2.0, 2.0])
        assert sizes["rmse_deg"] == pytest.approx([math.sqrt(5.0), 2.0])
        assert sizes["max_deg"] == pytest.approx([3.0, 2.0])
        assert np.isnan(sizes_deg(e[:0])["mae_deg"]).all()


C1, C2, C3 = "controller_1", "controller_2", "controller_3"


OWN, NONE = "user law mine", math.nan


class TestRanking:
    @pytest.mark.parametrize(
        ("errors", "order", "agrees"),
        [
            ({C1: 1, C2: 2, C3: 3}, [C1, C2, C3], True),
            ({C1: 1, C2: 1, C3: 3}, [C1, C2, C3], False),  # equal errors are no order
            ({C1: 1, C3: 3}, [C1, C3], True),
            ({C1: NONE, C2: 2, C3: 3}, [C2, C3, C1], False),
            ({C1: 1, C2: NONE, C3: NONE}, [C1, C2, C3], False),  # nor are two without any
            ({C1: 1, C2: 2, C3: 3, OWN: 0.5}, [OWN, C1, C2, C3], True),  # no part of the printed order
            ({C1: 1, OWN: 2}, [C1, OWN], None),
        ],
    )
    def test_order_and_whether_it_is_the_printed_one(
        self, errors: dict[str, float], order: list[str], agrees: bool | None
    ) -> None:
        found = ranking(constant_errors({run: (size, 1.0) for run, size in errors.items()}))
        assert found["joint_2"]["mae"] == found["joint_2"]["rmse"] == {"order": order, "agrees": agrees}
        assert found["joint_3"]["mae"]["order"] == [*errors]

    def test_one_run_has_no_rank(self) -> None:
        assert ranking(make_compare_file(runs=[C1, "controller_1_payload"])) == {}


def test_a_users_law_has_both_loads() -> None:
    file = constant_errors({"mine": (1, 1), "mine_payload": (2, 2)})
    found = {load: trace.name for load, trace in loaded_runs(file).items()}
    assert found == {"mine_no_load": "mine", "mine_with_load": "mine_payload"}


class TestTension:
    """Joint torque that rope of known tension makes is told back as that tension."""

    @staticmethod
    def made(tension: Array, time: Array | None = None) -> tuple[TraceFile, Trace]:
        """A run of joints 2 and 3 whose tendons have some tensions, (T, 2)."""
        file = make_compare_file(runs=["controller_1"])
        trace = file.runs["controller_1"]
        # Tendon 2 turns joint 2 at 38.5 mm; tendon 3 pulls it back at 17.5 mm and turns joint 3 at 18.5 mm.
        torque = np.stack([0.0385 * tension[:, 0] - 0.0175 * tension[:, 1], 0.0185 * tension[:, 1]], axis=1)
        steps = np.arange(len(torque)) * 0.5 if time is None else time
        return file, dataclasses.replace(trace, time=steps, variables={"tau_s": torque})

    def test_of_known_rope(self) -> None:
        tension = np.array([[30.0, 6.0], [20.0, 5.0], [25.0, 7.0]])
        assert tensions(*self.made(tension)) == pytest.approx(tension)
        sizes = tension_sizes(*self.made(tension))
        assert sizes["least_N"] == pytest.approx([20.0, 5.0])
        assert sizes["at_s"].tolist() == [0.5, 0.5]
        assert sizes["slack_s"].tolist() == [0.0, 0.0]

    def test_time_without_pull_counts_pushing_and_slack(self) -> None:
        tension = np.array([[30.0, 0.0], [-1.0, 1e-12], [25.0, 7.0], [-1.0, 7.0]])
        sizes = tension_sizes(*self.made(tension, np.array([0.0, 0.1, 0.4, 1.0])))
        assert sizes["slack_s"] == pytest.approx([0.3, 0.4]), "what follows the last sample is not known"

    def test_a_run_that_ends_in_numbers_that_are_none(self) -> None:
        tension = np.array([[30.0, 6.0], [20.0, 5.0], [math.nan, 7.0]])
        assert tension_sizes(*self.made(tension))["least_N"] == pytest.approx([20.0, 5.0])
        assert tension_sizes(*self.made(np.full((2, 2), math.nan))) == {}


def test_a_trace_has_the_statistics_of_the_batch() -> None:
    """The shipped arm starts cold, so its first epsilon is 124 rad/s2."""
    loaded = load_config("compare", "compare", overrides=["manipulator.actuator.torque_limit=[4, 4, 4]"])
    loops = all_loops(loaded)
    batch = simulate_batch([*loops.values()], record=True)
    assert batch.traces is not None
    reached = []
    for k, (name, loop) in enumerate(loops.items()):
        variables = dict(batch.traces[k] or {})
        trace = Trace(name, variables.pop("time"), loaded.config.joints, variables, {})
        found = statistics(trace)
        found["saturated"] = saturated(trace, loop.plant.drive.S, loop.actuator.limit)
        torque, limit = np.abs(trace["tau_m"] @ loop.plant.drive.S), loop.actuator.limit
        reached.append(np.isclose(torque, limit, rtol=1e-9, atol=0.0).mean(axis=0))
        assert found["saturated"] == pytest.approx(reached[-1])
        assert len(found) == 32
        for statistic, values in found.items():
            expected = batch.statistics[statistic][k]
            np.testing.assert_allclose(values, expected, rtol=1e-9, err_msg=f"{name} {statistic}")
    assert np.max(reached) > 0.0, "no motor gives all it can"


@pytest.mark.parametrize("sample", [0, 1, 700])
def test_a_pulse_of_epsilon_is_as_fast_at_the_start_as_later(sample: int) -> None:
    """A pulse keeps the same power below 3 Hz wherever it stands: the low-pass's response to a pulse."""
    epsilon = np.zeros((2000, 2))
    epsilon[sample] = 5.0, -50.0
    found = statistics(Trace("mine", np.arange(2000) * 1e-3, (2, 3), {"epsilon": epsilon}, {}))
    kept = np.exp(-2.0 * np.pi * 3.0 * 1e-3)
    energy = (1.0 - kept) ** 2 / (1.0 - kept**2)
    slow = np.array([5.0, 50.0]) * np.sqrt(energy / 1999)
    assert found["epsilon_slow_rms"] == pytest.approx(slow, rel=1e-9)


def test_without_a_motion_there_are_no_phases() -> None:
    time = np.arange(50) * 1e-3
    trace = Trace("mine", time, (2, 3), {"tau_m": np.ones((50, 2))}, {})
    found = statistics(trace)
    assert "torque_rms" in found
    assert not [name for name in found if name.endswith(("_up", "_down"))]
    rates = np.ones((50, 2)), np.zeros((50, 2))
    moving = statistics(trace, rates)
    np.testing.assert_allclose(moving["torque_rms_up"], 1.0)
    assert np.isnan(moving["torque_rms_down"]).all()


def test_what_a_plant_was_fitted_under_has_its_motion_and_starts() -> None:
    text = "reference:\n  kind: ramp\n  rise: {source: 'identified: Tables 2 and 3, misfit 0.01, rise'}\n"
    file = make_compare_file()
    assert fitted_under(file) is None
    fitted = dataclasses.replace(file, config_yaml=text)
    assert fitted_under(with_what_they_are(fitted)) == "motion=ramp"
    beside = {**file.runs[C2].attributes, "start_offset": [0.0, 0.01]}
    runs = {**file.runs, C2: dataclasses.replace(file.runs[C2], attributes=beside)}
    apart = with_what_they_are(dataclasses.replace(fitted, runs=runs))
    assert fitted_under(apart) == "motion=ramp+starts=apart"
    first = dataclasses.replace(apart, runs={C1: apart.runs[C1]})
    assert fitted_under(first) == fitted_under(apart), "it depends on the runs that a figure shows"


def noisy_logs() -> Array:
    """Of 4000 draws, 3 runs, 2 metrics and 2 joints."""
    return np.log(with_noise(np.ones((4000, 3, 2, 2)), NOISE, np.random.default_rng(1)))


def test_noise_is_shared_by_mae_and_rmse_but_for_a_part() -> None:
    assert noisy_logs().std(axis=0) == pytest.approx(0.02, rel=0.1)
    assert (noisy_logs()[:, :, 1] - noisy_logs()[:, :, 0]).std(axis=0) == pytest.approx(0.005, rel=0.1)


def test_the_covariance_is_that_of_the_noise() -> None:
    kept = np.ones((3, 2, 2), dtype=bool)
    kept[1, 0, 1] = False
    found = np.cov(noisy_logs()[:, kept].T)
    np.testing.assert_allclose(noise_covariance(kept), found, atol=0.1 * NOISE**2)
