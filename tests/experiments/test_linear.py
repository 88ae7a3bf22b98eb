"""A run may end well although its linear loop grows; the comparison says so."""

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_reference, growing, run_views
from tendonrepro.physics.linear_loop import decay_rate, stroke


def test_loops_that_grow_are_those_without_decay():
    assert growing(load_config(None, "compare")) == {}
    assert growing(load_config(None, "decouple")) == {}
    # At this mass of the law the loop with payload alone grows.
    heavy = load_config(None, "compare", overrides=("control.gains.M_bar=[0.03, 0.03]",))
    postures = list(stroke(build_reference(heavy.config.reference, heavy.config, heavy.folder).q_d))
    views = run_views(heavy.config).items()
    decay = {run: decay_rate(postures, view.plant, view.law) for run, view in views}
    found = growing(heavy)
    assert found.keys() == {run for run, rate in decay.items() if rate < 0.0} == {"controller_1_payload"}
    assert 11.1 < found["controller_1_payload"] < 11.4
