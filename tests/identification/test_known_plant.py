"""A made-up paper from a known plant of the box: identified back."""

import numpy as np
import pytest
from support.made_plants import paper_with

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import parse_reading
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.identification import command
from tendonrepro.identification.misfit import Bench
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol
from tendonrepro.simulation.batch import simulate_batch

pytestmark = pytest.mark.slow

# The known plant is quiet, of one kind of motion and friction, and quick; the rest of the box stays free.
FIXED = {
    "disturbance": "none",
    "friction_sides": "both",
    "motion": "raised_cosine",
    "torque_noise_acts": "off",
    "torque_resolution_acts": "off",
}
OVERRIDES = [f"box.{row}.choices=[{choice}]" for row, choice in FIXED.items()]
OVERRIDES += [f"box.{row}.nominal={choice}" for row, choice in FIXED.items()]
OVERRIDES += ["box.period.low=4", "box.period.nominal=4.5", "box.period.high=5"]
READING = "weights=extrapolating"


@pytest.fixture(scope="module")
def truth():
    """Numbers, (4, 2, 2), of the first plant of the box all of whose runs are ok."""
    loaded = load_ensemble(None, overrides=OVERRIDES)
    box = make_box(loaded.config)
    bench = Bench(loaded.base, box, "whole", simulate_batch)
    found = bench.measure(scrambled_sobol(box, 77, 0, 0, 32), parse_reading(READING), RUNS)
    well = found.ok.all(axis=1) & (found.sizes.max(axis=(1, 2, 3)) < 2.0)
    return found.sizes[np.flatnonzero(well)[0]]


def test_a_known_plant_fits_its_own_numbers_and_they_are_not_those_of_the_paper(truth, tmp_path, monkeypatch):
    monkeypatch.setattr(command, "published", lambda: paper_with(truth, decimals=6))
    request, effort = Request(out=tmp_path / "out", overrides=OVERRIDES), (40, 24, 2)
    asked = dict(zip(("generations", "population", "seeds"), effort, strict=True))
    found = command.run_identify(request, Talk(quiet=True), readings=READING, **asked)["readings"][0]
    assert found["misfit_log"] < 0.05
    fitted = [row for row in found["numbers"] if row["fitted"]]
    assert [row["printed_deg"] for row in fitted] == pytest.approx(truth[1].ravel(), rel=1e-4)
    assert [row["ours_deg"] for row in fitted] == pytest.approx(truth[1].ravel(), rel=0.1)
