"""When a measured motion begins, what bridges its gaps, and that neither hides the window of the tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import COUNT, make_compare_file

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import noise, recorded
from tendonrepro.dataset.motion.recover import recover, recover_run
from tendonrepro.physics.trajectory import Motion, motion, smooth_sine, trapezoidal
from tendonrepro.results.records import Trace
from tendonrepro.validation.rerun import departure

SIZE = np.deg2rad(24.0)
TRAPEZOID = trapezoidal(SIZE, *np.deg2rad([20.0, 40.0]), 1.0)


def trace(time: Array, q: Array) -> Trace:
    attributes = {"law": "measured", "reference_period": 0.0, "status": "ok", "payload_mass": 0.0}
    return Trace("controller_1", time, (2, 3)[: q.shape[1]], {"q_d": q}, attributes)


def of_shapes(time: Array, delay: float, *shapes: object) -> Array:
    return motion(time - delay, [Motion((shape,), 100.0) for shape in shapes])[0]  # type: ignore[arg-type]


class TestBegin:
    @pytest.mark.parametrize("delay", [0.2, 2.0])
    def test_joints_of_different_pace_tell_it_exactly(self, delay: float) -> None:
        """Synchronised ramps have no common shape, each joint has its own."""
        time = 0.001 * np.arange(18000.0)
        limits = np.deg2rad([12.0, 24.0]), np.deg2rad([8.0, 16.0])
        q = of_shapes(
            time, delay, trapezoidal(SIZE, *limits[0], 1.0), trapezoidal(SIZE / 1.5, *limits[1], 1.0)
        )
        found = recover_run(trace(time, COUNT * np.round(q / COUNT)))
        assert found.shape is None
        assert found.begin == pytest.approx(delay, abs=5e-4)

    def test_without_any_shape_it_is_where_the_start_is_left(self) -> None:
        time = 0.001 * np.arange(15000.0)
        since = np.clip(time - 0.7, 0.0, None)[:, np.newaxis]
        odd = 0.4 * np.sin(since) ** 2 * (1.0 + 0.3 * np.sin(3.1 * since) + 0.2 * np.sin(0.37 * since))
        found = recover_run(trace(time, odd * np.array([1.0, 0.7])))
        assert found.shape is None
        assert 0.7 < found.begin < 0.75


class TestGaps:
    @staticmethod
    def gapped(first: int, last: int) -> tuple[Trace, Array]:
        time = 0.001 * np.arange(17000.0)
        q = of_shapes(time, 0.83, *(smooth_sine(size, 0.0, 5.0, 2.5) for size in np.deg2rad([45.0, 35.0])))
        holed = q.copy()
        holed[first:last] = np.nan
        return trace(time, holed), q

    @pytest.mark.parametrize("width", [1, 61, 301])
    def test_a_motion_is_recovered_across_one(self, width: int) -> None:
        holed, _ = self.gapped(2000, 2000 + width)
        found = recover_run(holed)
        assert found.shape.kind == "sine"
        assert found.delay == pytest.approx(0.83, abs=1e-4)
        assert found.record.missing == width
        assert found.record.known[[1999, 2000 + width]].all()

    def test_uneven_times_are_no_gaps(self) -> None:
        rng = np.random.default_rng(5)
        time = 0.01 * np.arange(500.0) + 0.003 * rng.uniform(-1.0, 1.0, 500)
        assert recorded(trace(time, np.sin(time)[:, np.newaxis])).missing == 0

    def test_a_gap_of_the_other_run_is_no_departure(self) -> None:
        file = make_compare_file(step=0.005, source="measured")
        first, second = file.runs["controller_1"], file.runs["controller_2"]
        q_d = first["q_d"].copy()
        q_d[300:420] = np.nan
        runs = file.runs | {"controller_1": replace(first, variables=dict(first.variables) | {"q_d": q_d})}
        reference = recover(replace(file, runs=runs))
        assert reference.record.missing == 120
        assert departure(second, reference) == 0.0


def test_noise_of_one_count_does_not_begin_the_motion() -> None:
    time = 0.001 * np.arange(12000.0)
    rough = COUNT * np.random.default_rng(7).standard_normal((12000, 2))
    record = recorded(trace(time, of_shapes(time, 1.5, TRAPEZOID, TRAPEZOID) + rough))
    assert noise(record) == pytest.approx(COUNT, rel=0.05)
    assert 1450 < record.moving()[0] < 1650
