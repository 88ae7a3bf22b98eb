"""Loops that share their parts are those of each run alone, to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from support.fake_batch import fingerprint

from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.models.readings import Reading, parse_reading, under
from tendonrepro.experiments.loops import build_loops
from tendonrepro.experiments.rig import build_plant
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.monte_carlo.plan import EnsembleStudy
from tendonrepro.monte_carlo.population import Population
from tendonrepro.physics.dynamics import frictionless, holding_torque, rest_state, state_derivative
from tendonrepro.physics.linear_loop import plant_matrices
from tendonrepro.physics.loads import no_disturbance


@cache
def study() -> EnsembleStudy:
    return load_study(None, (), None, "default")


def drawn(count: int) -> tuple[Population, np.ndarray]:
    box = study().population
    return box, box.sample(7, 0, 0, count)


def assert_same(box: Population, row: np.ndarray, cases: Sequence[tuple[str, Reading]]) -> None:
    (loops,) = box.loops(row[np.newaxis], cases)
    base = study().loaded.base
    config = box.configured(row)
    for (run, reading), loop in zip(cases, loops, strict=True):
        changed = under(reading, config, box.named(row))
        alone = changed.model_copy(update={"runs": {run: changed.runs[run]}})
        plain = dict(build_loops(alone, base.folder))[run]
        assert fingerprint(loop) == fingerprint(plain), (run, reading.name)
        for name in ("time", "q_d", "dq_d", "ddq_d"):
            np.testing.assert_array_equal(getattr(loop.reference, name), getattr(plain.reference, name))


def test_every_reading_on_some_draw_equals_each_run_alone() -> None:
    """One run of each reading, and other draws for others."""
    cases = [*{reading: (run, reading) for run, reading in study().cases}.values()]
    box, values = drawn(8)
    for k, row in enumerate(values):
        assert_same(box, row, cases[k :: len(values)])


def test_draws_on_one_motion_share_it(tmp_path: Path) -> None:
    """Around an arm of one's own all follow its motion, but where a reading samples it otherwise."""
    init_arm(2, tmp_path)
    other = load_study(tmp_path / "compare.yaml", None, None, "printed", 0.2)
    arms = other.population
    slower = parse_reading("sampling_period=2ms")
    cases = [*other.cases, ("controller_1", slower)]
    first, second = arms.loops(arms.sample(1, 0, 0, 2), cases)
    assert first[0].reference is second[0].reference is not first[-1].reference
    assert first[-1].reference is second[-1].reference
    assert (first[0].plant.arm.b != second[0].plant.arm.b).any()


def test_the_linear_loop_has_what_is_drawn():
    """A parameter that the linear plant forgets would make the margins of `explain` wrong without a word."""
    (box, rows), q, h = drawn(4), np.array([0.3, 0.4]), 1e-6
    for row in rows:
        plant = frictionless(build_plant(box.configured(row), 0.2))
        # Clearance and transmission error are no part of it.
        off = {name: np.zeros(q.size) for name in ("slack", "wobble")}
        plant = plant._replace(drive=plant.drive._replace(**off), disturbance=no_disturbance(q.size))
        x, tau = rest_state(q, plant), holding_torque(q, plant)
        forward, backward = (
            state_derivative(0.0, x[:, np.newaxis] + step * np.eye(x.size), tau[:, np.newaxis], plant)
            for step in (h, -h)
        )
        A, _ = plant_matrices(q, plant)
        np.testing.assert_allclose((forward - backward) / (2.0 * h), A, atol=1e-8 * np.abs(A).max())
