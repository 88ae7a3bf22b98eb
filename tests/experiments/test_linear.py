"""A run may end well although its linear loop grows; the comparison says so."""

from tendonrepro.config.load import load_config
from tendonrepro.experiments.linear import growing, run_views
from tendonrepro.experiments.report import _growing
from tendonrepro.explain.analysis import explain


def test_loops_that_grow_are_those_that_explain_finds():
    assert growing(load_config(None, "compare")) == {}
    undamped = load_config(None, "compare", overrides=("manipulator.tendons.damping_factor=1",))
    found, margins = growing(undamped), explain(undamped).margins
    assert found.keys() == run_views(undamped.config).keys()
    assert found == {run: margin.frequency for run, margin in margins.items() if margin.decay < 0.0}
    assert growing(load_config(None, "decouple")) == {}


def test_only_runs_that_ended_well_are_said_to_grow():
    status = {"controller_1": "ok", "controller_2": "ringing", "controller_3": "ok"}
    (line,) = _growing({"growing_hz": {"controller_1": 4.31, "controller_2": 4.3}, "status": status})
    assert ": controller_1 at 4.3 Hz; see tendonrepro explain" in line
    assert _growing({"growing_hz": {"controller_2": 4.3}, "status": status}) == []
