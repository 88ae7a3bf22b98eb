"""Laws that are the same law: each equivalence holds on the flexible arm, and knowledge helps every law."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.physics.control import error_rate, start_memory
from tendonrepro.physics.drive import Encoder
from tendonrepro.physics.dynamics import frictionless, load_at_rest
from tendonrepro.simulation.loop import TimeDelayController
from tendonrepro.simulation.stepper import simulate
from tendonrepro.tuning.bench import (
    CONDITIONS,
    EQUIVALENCES,
    KNOWN,
    LAWS,
    PUBLISHED,
    Candidate,
    Equivalence,
    Gains,
    TrialPlants,
    known_along,
    loops_of,
    measure,
    posed,
    super_twisting,
    tuned_user_law,
)

M_BAR = [1e-3, 8e-4]
NTSM = {"M_bar": M_BAR, "lam": [30.0], "eta": [17.0], "b": [0.9], "Delta": [0.2]}
LINEAR = {"M_bar": M_BAR, "K_d": [50.0], "K_p": [600.0]}
NUMBERS = {
    "pid": LINEAR,
    "tdc": LINEAR,
    "dob": LINEAR | {"estimate_filter": [0.5]},
    "tsm": {"M_bar": M_BAR, "lam": [30.0], "beta": [20.0]},
    "ntsm": NTSM,
    "alpha_published": NTSM,
    "alpha_extrapolating": NTSM,
    "alpha_free": NTSM | {"alpha": [0.1, 0.3]},
    "super_twisting": {"M_bar": [0.1, 0.08], "beta": [20.0], "k_1": [5.0], "k_2": [100.0]},
}
GOOD = {law: {name: np.array(value) for name, value in gains.items()} for law, gains in NUMBERS.items()}


@cache
def nominal() -> TrialPlants:
    """The box's middle, with ideal encoders."""
    loaded = load_ensemble(None)
    box = population_of(loaded)
    plants = posed(box.configured(box.nominal))
    ideal = Encoder(0.0, 0.0)
    return plants._replace(loops=tuple(replace(loop, joint_encoder=ideal) for loop in plants.loops))


def errors(law: str, gains: Gains, condition: str = PUBLISHED) -> Array:
    found = measure(nominal(), [Candidate(LAWS[law], condition, gains)])
    assert found.stable[:, :2].all() or law == "super_twisting"
    return found.mae[0, :2]


def changed(equal: Equivalence) -> Gains:
    """Gains of the target, by way of the cube in which it is searched."""
    law = LAWS[equal.target]
    return law.values(law.unit(equal.change(GOOD[equal.source], nominal().alpha), 2), 2)


@pytest.mark.parametrize(
    "brought",
    [{"bounds": {"K_p": held}} for held in (10.0, (1.0, 1.0), (0.0, 1.0))]
    + [{}, {"bounds": {"unknown": (1.0, 2.0)}}, {"bounds": {"K_p": (1.0, 10.0)}, "setup": print}],
)
def test_a_users_law_without_bounds_or_with_a_setup_is_refused(brought: dict[str, Any]) -> None:
    def law(*_: Any) -> None:
        """Would be called."""

    vars(law).update(brought)
    with pytest.raises(UsageError):
        tuned_user_law(UserLaw("mine", given=law))


EXACT = [equal for equal in EQUIVALENCES if equal.exact]
NEAR = [equal for equal in EQUIVALENCES if not equal.exact and equal.target != "super_twisting"]


@pytest.mark.parametrize("equal", EXACT, ids=lambda equal: f"{equal.source}-{equal.target}")
@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_special_case_gives_the_same_run(equal: Equivalence, condition: str) -> None:
    general = errors(equal.target, changed(equal), condition)
    special = errors(equal.source, GOOD[equal.source], condition)
    assert np.allclose(general, special, rtol=1e-6)


@pytest.mark.parametrize("equal", NEAR, ids=lambda equal: f"{equal.source}-{equal.target}")
def test_a_near_equivalence_is_near(equal: Equivalence) -> None:
    assert np.allclose(
        errors(equal.target, changed(equal)), errors(equal.source, GOOD[equal.source]), rtol=0.05
    )


def test_pid_is_the_textbooks() -> None:
    """An independent program: proportional, integral and derivative parts as they are taught."""
    loop = loops_of(nominal(), Candidate(LAWS["pid"], PUBLISHED, GOOD["pid"]))[0]
    law = loop.controller.law
    total = []

    def pid(memory, q, q_d, dq_d, _, law):  # type: ignore[no-untyped-def]
        if not total:
            total.append(memory.tau[0])
        error, rate = q_d - q, error_rate(memory, q, q_d, dq_d, law)
        total.append(total[-1] + law.M_bar * law.K_p * error)
        none = np.zeros_like(q)
        return total[-1] + law.M_bar / law.L * (rate + law.K_d * error), none, none, rate

    own = simulate(replace(loop, controller=TimeDelayController(law, pid)))
    ours = simulate(loop)
    size = np.abs(ours["e"]).max(axis=0)
    assert (np.abs(own["e"] - ours["e"]).max(axis=0) < 0.03 * size).all()


def test_super_twisting_by_hand() -> None:
    """At rest beside the reference by 0.1 rad: s is 2 and −2, and the integral grows by L M_bar k_2."""
    candidate = Candidate(LAWS["super_twisting"], PUBLISHED, GOOD["super_twisting"])
    (loop,), nothing = loops_of(nominal(), candidate, 1), np.zeros(2)
    given = nothing, np.array([0.1, -0.1]), nothing, nothing, loop.controller.law
    tau, integral, s, de = super_twisting(start_memory(nothing, nothing), *given)
    assert np.allclose([s, de, integral], [[2.0, -2.0], nothing, [0.01, -0.008]])
    assert np.allclose(tau - integral, np.array([0.1, -0.08]) * 5.0 * np.sqrt(2.0))


def test_the_known_torque_holds_the_arm_at_the_start_of_a_motion() -> None:
    loop = nominal().loops[0]
    torque, _ = known_along(loop.plant, loop.reference)
    assert np.allclose(torque[0], load_at_rest(loop.reference.q_d[0], loop.plant))


def test_super_twisting_on_lanes_is_the_function_itself() -> None:
    candidate = Candidate(LAWS["super_twisting"], KNOWN, GOOD["super_twisting"])
    alone = simulate(loops_of(nominal(), candidate)[1])
    assert np.allclose(np.abs(alone["e"]).mean(axis=0), measure(nominal(), [candidate]).mae[0, 1], rtol=1e-4)


@pytest.mark.parametrize("law", ["tdc", "dob", "alpha_free"])
def test_what_is_known_need_not_be_estimated(law: str) -> None:
    """Without dry friction and disturbance the model is all but the whole truth; tendons give a little."""
    plants = nominal()
    smooth = tuple(replace(loop, plant=frictionless(loop.plant)) for loop in plants.loops)
    known = [known_along(smooth[0].plant, loop.reference) for loop in (smooth[0], smooth[-1])]
    plants = plants._replace(loops=smooth, known=known)
    found = measure(plants, [Candidate(LAWS[law], condition, GOOD[law]) for condition in CONDITIONS])
    nothing, everything = found.mae[:, 0].mean(axis=1)
    assert everything < 0.15 * nothing
