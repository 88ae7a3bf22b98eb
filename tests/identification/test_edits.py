"""Every small change of the equations: what the rules make, which readings they hold, and how they rank."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.stats import multivariate_t

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_plants
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import Readings
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.readings import parse_reading, under
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import all_loops, build_law
from tendonrepro.experiments.user_law import laws_of
from tendonrepro.identification.edits import study as edits_study
from tendonrepro.identification.edits.rank import Outcomes, edits_result, planted, ranking
from tendonrepro.identification.edits.recorded import UNPRINTED, EditedLaw, recorded
from tendonrepro.identification.edits.rules import (
    Anatomy,
    Variant,
    Variants,
    edits_of,
    law_of,
    states,
    torques,
    variants_of,
)
from tendonrepro.identification.edits.study import EditStudy, edited_goal
from tendonrepro.monte_carlo.kept import stub_of
from tendonrepro.physics import control
from tendonrepro.physics.control import Law
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.stepper import simulate
from tendonrepro.studies.study import Site

CONTROLLERS = ("controller_1", "controller_2", "controller_3")


@cache
def config() -> CompareConfig:
    loaded = load_config("compare", "compare").config
    assert isinstance(loaded, CompareConfig)
    return loaded


@cache
def loops() -> dict[str, Loop]:
    of_all = all_loops(load_config("compare", "compare"))
    return {run: of_all[run] for run in CONTROLLERS}


@cache
def every_edit() -> Variants:
    return variants_of(loops())


def of_physics(law: Law) -> Array:
    """Torques and accelerations at the states, without a tape."""
    memory, q, q_d, dq_d, ddq_d = states(2)
    depth = {"q": 3 * law.lag, "tau": 2 * law.lag, "ddq": law.lag}
    memory = memory._replace(**{name: getattr(memory, name)[:size] for name, size in depth.items()})
    tau, *_ = control.command(memory, q, q_d, dq_d, law.feed_forward * ddq_d, law)
    return np.concatenate([np.ravel(tau), np.ravel(control.delayed_acceleration(memory, q, law))])


@pytest.mark.parametrize("run", CONTROLLERS)
def test_a_law_without_an_edit_is_the_law_to_the_last_bit(run: str) -> None:
    law = law_of(loops()[run])
    assert np.array_equal(torques(EditedLaw(law)), of_physics(law.law), equal_nan=True)


@pytest.mark.parametrize("run", CONTROLLERS)
def test_every_operation_of_the_law_has_an_equation_and_every_input_its_letters(run: str) -> None:
    """The table of equations stands beside the law, which knows nothing of it."""
    of = Anatomy(law_of(loops()[run]))
    assert all(not of.equations[name].startswith("line") for name in of.used)
    inputs = {
        each for name in of.used for each in of.lines[name][1] if isinstance(each, str) and of.is_input(each)
    }
    assert not [words for words in map(of.words, inputs) if "." in words or "[" in words]


def test_every_printed_equation_of_the_laws_is_edited() -> None:
    edited = {edit.name.partition(":")[0] for edit in every_edit().edits}
    assert {f"Eq. ({number})" for number in (8, 11, 12, 13, 15, 16, 17, 18)} <= edited
    assert UNPRINTED not in edited


READINGS = {
    "phi_negative=even": "everywhere: e for |e|",
    "phi_branch=power": "everywhere: always sig(e)^b",
    "weights=extrapolating": "everywhere: α with the other sign",
    "weights=swapped": "Eq. (15): 1 − α and α exchanged",
    "differencing=centred": "Eq. (16): q(t−L) − 2 q(t−2L) + q(t−3L) one L newer",
    "gain_unit=phi_in_degrees": "Eq. (12): e in degrees",
    "gain_unit=law_in_degrees": "everywhere: all angles in degrees",
    "Delta_unit=deg": "everywhere: Δ in degrees",
    "eta_in_controller_2=dropped": "Eq. (18): factor η left out, in Controller 2 alone",
    "delay_time=two_periods": "everywhere: L of two sampling periods",
    "delay_time=four_periods": "everywhere: L of four sampling periods",
    "reference_acceleration=absent": "everywhere: q̈_d left out",
}
"""Readings that change an equation, and the edits that they are."""

NO_EDITS = {
    "torque_coordinates",
    "torque_unit",
    "stored_torque",
    "estimate_filter",
    "feedback",
    "reference_acceleration=late",
    "start",
    "error_rate",
}
"""Readings that are no edit of one place, or the one value that is none."""


def test_every_reading_is_an_edit_or_known_to_be_none() -> None:
    axes = {name: get_args(field.annotation)[1:] for name, field in Readings.model_fields.items()}
    settings = {f"{name}={value}" for name, values in axes.items() for value in values}
    assert {each for each in settings if not {each, each.partition("=")[0]} & NO_EDITS} == READINGS.keys()
    assert {part for each in settings for part in (each, each.partition("=")[0])} >= NO_EDITS


@pytest.mark.parametrize("reading", READINGS)
def test_a_reading_of_an_equation_is_one_of_the_edits(reading: str) -> None:
    changed = under(parse_reading(reading), config(), {})
    (edit,) = (edit for edit in every_edit().edits if edit.name == READINGS[reading])
    for run, loop in loops().items():
        law = edit.laws.get(run, EditedLaw(law_of(loop)))
        np.testing.assert_allclose(torques(law), of_physics(build_law(changed, run)), rtol=1e-9, atol=1e-9)


def test_m_bar_in_degrees_is_an_inertia_per_degree() -> None:
    """0.01 N m per deg/s² are 0.01 · 180/π per rad/s²."""
    (edit,) = (edit for edit in every_edit().edits if edit.name == "everywhere: M̄ in degrees")
    assert edit.laws.keys() == {*CONTROLLERS}
    for law in edit.laws.values():
        larger = law.base.law._replace(M_bar=np.rad2deg(law.base.law.M_bar))
        np.testing.assert_allclose(torques(law), of_physics(larger), rtol=1e-9, atol=1e-9)


def test_names_tell_edits_apart_and_equal_ones_stand_once() -> None:
    made = every_edit()
    names = [name for edit in made.edits for name in (edit.name, *edit.others)]
    names += [*made.unchanged, *made.no_number]
    assert len(names) == len({*names}) == made.made
    (dropped,) = (edit for edit in made.edits if edit.name == "Eq. (15): α left out")
    assert "Eq. (15): factor 1 − α left out" in dropped.others
    # The gains of both joints are equal, except α.
    assert {name for name in made.unchanged if "λ of the other joint" in name}
    assert not {name for name in made.unchanged if "α of the other joint" in name}


def test_an_edit_of_eq_16_is_remembered_for_the_second_estimate() -> None:
    """The acceleration at t − 2L is that of Eq. (16) a delay ago, whichever way it was made."""
    base = recorded(build_law(config(), "controller_1")._replace(lag=2))
    law = EditedLaw(base, edits_of(base)[READINGS["differencing=centred"]])
    memory, q, q_d, *_ = states(2)
    memory = memory._replace(q=memory.q[:6], tau=memory.tau[:4], ddq=memory.ddq[:2])
    ours = law.remember(memory, q, q_d, q, q, q, base.law)
    theirs = control.remember(memory, q, q_d, q, q, q, base.law._replace(newest=0))
    np.testing.assert_allclose(ours.ddq, theirs.ddq, rtol=1e-12)


def test_a_recorded_law_runs_as_the_law_and_an_edit_as_its_reading() -> None:
    """In closed loop, on lanes."""
    loop = stub_of(loops()["controller_1"])
    (edit,) = (edit for edit in every_edit().edits if edit.name == READINGS["weights=extrapolating"])
    other = build_law(under(parse_reading("weights=extrapolating"), config(), {}), "controller_1")
    law = law_of(loop)

    def run(**changes: object) -> Array:
        controller = replace(loop.controller, **changes)  # type: ignore[arg-type]
        batch = simulate_batch([replace(loop, controller=controller)])
        return np.concatenate([batch.statistics[name][0] for name in ("mae", "torque_step_rms")])

    assert np.array_equal(run(), run(command=EditedLaw(law), on_lanes=True))
    edited = run(command=edit.laws["controller_1"], on_lanes=True)
    np.testing.assert_allclose(edited, run(law=other), rtol=1e-6)
    assert not np.array_equal(edited, run())


def made_tables(apart: float) -> Outcomes:
    """Six edits that move other errors, on plants that scatter by 5 %; the last is stable on few."""
    draw = np.random.default_rng(1)
    sizes = np.exp(0.05 * draw.standard_normal((6, 80, 3, 2, 2)))
    for k in range(1, 6):
        sizes[k, :, k % 3, k % 2] *= 1.0 + apart * k
    stable = np.ones((6, 80), dtype=bool)
    stable[5, 10:] = False
    goal = edited_goal(load_plants(None), (), None)
    return Outcomes(0.3 * sizes, sizes[..., 0, 0], stable, goal, False)


def test_numbers_of_the_answer_by_another_way() -> None:
    """A share by counting, and likelihoods by SciPy's Student density around each plant."""
    of = made_tables(0.02)
    of = replace(of, absolute=True, sizes=of.sizes / 0.3 * of.goal.values)
    of.stable[0, :5] = of.stable[2, 70:] = False
    of.steps[:] = np.arange(6)[:, np.newaxis, np.newaxis] + 1.0
    of.steps[0, 5:38] = 0.1
    edits = tuple(Variant(f"edit {k}", {}) for k in range(1, 6))
    data = edits_result(Variants(edits, (), (), 5), {"printed": of}, 1).data
    assert data["factor"] == 4 / 0.05
    first, *_, last = data["ratios"]
    # MAE of Table 2: Controller 1 over Controller 2 on joint 2, and joint 3 over joint 2 of Controller 1.
    assert [*first.values()] == ["controller_1", 2, "controller_2", 2, pytest.approx(0.261 / 0.289)]
    assert [*last.values()] == ["controller_1", 3, "controller_1", 2, pytest.approx(0.219 / 0.261)]
    row, goal = data["edits"][2], of.goal
    table = goal.values.reshape(3, 4)
    orders = [
        all(np.array_equal(np.argsort(plant[:, k]), np.argsort(table[:, k])) for k in range(4))
        for plant in of.sizes[2, :70].reshape(70, 3, 4)
    ]
    assert (row["order_share"], row["stable_share"]) == (sum(orders) / 70, 70 / 80)
    assert 0 < sum(orders) < 70
    # Of the 65 plants that are stable without an edit, too, 33 have small steps there.
    assert row["torque_steps_over_none"] == pytest.approx(30.0)
    errors, logs = np.log(table.ravel()), np.log(of.sizes.reshape(6, 80, 12))
    run, metric, joint = np.indices((3, 2, 2)).reshape(3, 12)
    same = (run[:, np.newaxis] == run) & (joint[:, np.newaxis] == joint)
    noise = 0.02**2 * (same + np.diag(metric) / 16.0) + np.diag((0.0005 / table.ravel()) ** 2 / 3.0)

    def density(k: int) -> float:
        own = logs[k, of.stable[k]]
        within = np.clip(own, *np.quantile(own, [0.05, 0.95], axis=0))
        kernel = (4.0 / (14.0 * len(own))) ** (2.0 / 16.0) * np.cov(within, rowvar=False) + noise
        return sum(float(multivariate_t.pdf(errors, plant, kernel, df=4)) for plant in own) / 80.0

    assert row["log10_likelihood_ratio"] == pytest.approx(np.log10(density(2) / density(0)))


def test_planted_edits_are_found_where_they_are_large_and_none_is_named_without_one() -> None:
    shares = planted(made_tables(1.0), 40, 1)
    assert shares["in_first_three"]["share"] == shares["named"]["share"] == 1.0  # type: ignore[index]
    assert shares["clean_named"]["share"] <= 0.05  # type: ignore[index]


def test_edits_without_effect_share_the_class_of_none_and_those_on_few_plants_have_no_rank() -> None:
    of = made_tables(0.0)
    assert not of.ranked[5]
    assert not ranking(of, of.goal).named
    same = replace(of, sizes=np.repeat(of.sizes[:1], 6, axis=0))
    assert (same.classes[:5] == 0).all()
    # A factor on all errors is the plant's.
    larger = replace(of.goal, values=3.0 * of.goal.values, half=3.0 * of.goal.half)
    np.testing.assert_allclose(ranking(of, larger).ratios[:5], ranking(of, of.goal).ratios[:5], atol=1e-9)


def test_a_plant_that_made_a_table_counts_for_no_edit() -> None:
    of = made_tables(1.0)
    own = replace(of.goal, values=of.sizes[2, 3])
    assert of.of(own, without=3)[2] < of.of(own)[2]


def test_plants_are_run_once_and_err_as_by_scipy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two plants, one at a time, without edits; a second run finds them on disk."""
    monkeypatch.setattr(edits_study, "PLANTS_AT_ONCE", 1)
    loaded, site = load_plants(None), Site(Talk(), tmp_path)
    study = EditStudy(loaded, (), edited_goal(loaded, (), None), 2)
    study.__dict__["variants"] = Variants((), (), (), 0)
    records = study.run(site, 1)
    monkeypatch.setattr(edits_study, "simulate_batch", None)
    np.testing.assert_array_equal(study.run(site, 1), records)
    error = simulate(study.loops(1, 1)[0]["controller_2", "printed"])["e"]
    ours = np.rad2deg([np.abs(error).mean(axis=0), np.sqrt((error**2).mean(axis=0))])
    np.testing.assert_allclose(study.outcomes(records, 0).sizes[0, 1, 1], ours, rtol=0.03)


OWN = """
import numpy as np
from tendonrepro.physics.control import error_rate

def own(memory, q, q_d, dq_d, ddq_d, law):
    de = error_rate(memory, q, q_d, dq_d, law)
    e = q_d - q
    s = de + law.beta * e
    tau = memory.tau[0] + law.M_bar * (ddq_d + law.beta * de + law.lam * s)
    return tau, memory.tau[0], s, de

def branching(memory, q, q_d, dq_d, ddq_d, law):
    return q if q[0] > 0.0 else q_d
"""


@pytest.fixture
def own_law(tmp_path: Path) -> Path:
    path = tmp_path / "law.py"
    path.write_text(OWN)
    for name, run in (("errors", "own"), ("branching", "branching")):
        lines = "run,joint,mae_deg,rmse_deg", f"{run},2,0.25,0.31", f"{run},3,0.22,0.26"
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    return path


def user_study(own_law: Path, name: str, table: str = "errors.csv") -> EditStudy:
    loaded, laws = load_plants(None), laws_of([f"{own_law}:{name}"])
    return EditStudy(loaded, tuple(laws), edited_goal(loaded, laws, own_law.parent / table), 1)


def test_a_users_own_law_is_edited_by_its_lines(own_law: Path) -> None:
    edits = user_study(own_law, "own").variants.edits
    names = {edit.name for edit in edits}
    assert {"line 8: β with the other sign", "line 9: β and λ exchanged"} <= names
    # The rate of the error stands twice in the sum, and is shifted once.
    assert [name for name in names if name.startswith("line 9: ") and name.endswith(" one L older")]
    assert {tuple(edit.laws) for edit in edits} == {("own",)}


def test_what_cannot_be_edited_is_refused(own_law: Path) -> None:
    with pytest.raises(UsageError, match="branches in its line 13"):
        _ = user_study(own_law, "branching", "branching.csv").variants
    loaded, laws = load_plants(None), laws_of([f"{own_law}:own"])
    with pytest.raises(UsageError, match="no published errors"):
        edited_goal(loaded, laws, None)
    (own_law.parent / "other.csv").write_text("run,joint,mae_deg\ncontroller_1,2,0.25\n")
    with pytest.raises(UsageError, match="no errors of the run own"):
        edited_goal(loaded, laws, own_law.parent / "other.csv")
