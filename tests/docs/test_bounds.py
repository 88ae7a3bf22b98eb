"""The bounds of docs/theory.md: what is stored is what the code gives, and the least misfit is one."""

import importlib

import numpy as np
import pytest
from scipy.optimize import minimize
from support.pages import DOCS, NEEDS_DOCS, stated, stored

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.published import published
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.linear_loop import feedback_gains

pytestmark = NEEDS_DOCS
METRICS = ("mae", "rmse")


@pytest.fixture
def bounds(monkeypatch):
    """docs/bounds.py."""
    monkeypatch.syspath_prepend(DOCS)
    return importlib.import_module("bounds")


def test_stored_ranges_hold_on_the_first_arms(bounds):
    """Of the linear arms a few are made again; all of them lie inside what is stored."""
    linear, again = stored("bounds")["linear"], bounds.linear_bounds(8)
    for pair in ("controller_3_over_2", "controller_1_over_2"):
        for key, sign in (("low", 1.0), ("high", -1.0)):
            assert (sign * np.subtract(again[pair][key], linear[pair][key]) >= -1e-5).all()
        (low, high), (least, most) = again[pair]["all_joints"], linear[pair]["all_joints"]
        assert least - 1e-5 <= low <= high <= most + 1e-5


def test_stored_misfits_are_those_of_the_stored_bound(bounds):
    found = stored("bounds")
    again = bounds.least_misfits(found["linear"]["controller_3_over_2"]["all_joints"][1])
    assert again == pytest.approx(found["misfit_log"], abs=1e-5)


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        # Places of two controllers, and the least log ratio of the first over the second.
        ("printed", [(1, 2, -np.log(1.006)), (0, 1, 0.0)]),
        ("motion=ramp", [(1, 2, -np.log(1.006))]),
        ("Delta_unit=deg", [(0, 1, 0.0)]),
    ],
)
def test_no_numbers_within_the_bounds_are_nearer(bounds, name, limits):
    """By another way: a search over all sixteen logarithms under the same limits."""
    rows = ["table2.controller_1", "table2.controller_2", "table2.controller_3", "table3.with_load"]
    names = [f"{row}.{metric}.joint_{joint}" for row in rows for metric in METRICS for joint in (2, 3)]
    printed = np.log([published().number(each) for each in names])

    def apart(x):
        logs = (printed + x).reshape(4, 2, 2)[:, 1]
        return np.concatenate([logs[a] - logs[b] - least for a, b, least in limits])

    found = minimize(
        lambda x: x @ x, np.zeros(16), constraints={"type": "ineq", "fun": apart}, method="SLSQP", tol=1e-12
    )
    assert bounds.least_misfits(1.006)[name] == pytest.approx(np.sqrt(found.fun / 16.0), abs=1e-5)


def test_constants_of_the_bound():
    config = load_config("plain", "compare").config
    laws = [build_law(config, name) for name in ("controller_2", "controller_3")]
    k, beta = (feedback_gains(law)[0][0] / law.lam[0] for law in laws)
    page = "docs/theory.md"
    said = stated(r"k alone: η γ₁ = ([\d.]+) s⁻¹ and β = (\d) s⁻¹", page)
    assert said == pytest.approx([k, beta], abs=5e-4)
    (of_start,) = stated(r"or ([\d.]+) s e₀²\.", page)
    assert of_start == pytest.approx((beta - k) / (16.0 * (beta + k)), abs=5e-5)
    printed = [
        published().number(f"table2.controller_3.rmse.joint_{joint}")
        / published().number(f"table2.controller_2.rmse.joint_{joint}")
        for joint in (2, 3)
    ]
    assert stated(r"Table 2 has ([\d.]+) and ([\d.]+)\.\*\*", page) == pytest.approx(printed, abs=5e-4)
