"""The box: draws within bounds whatever the blocks, and plants that mean what the rows say."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import qmc
from support.made_ensemble import box

from tendonrepro.configuration.models.box import WORDS
from tendonrepro.configuration.models.readings import (
    UNDER_READINGS,
    parse_reading,
    under,
)
from tendonrepro.experiments.loops import build_loops
from tendonrepro.experiments.rig import build_drive, build_plant
from tendonrepro.monte_carlo.ensemble import load_study

DRAWS = 256


@cache
def draws():
    return box().sample(1, 0, 0, DRAWS)


@cache
def drawn(k):
    return box().configured(draws()[k])


def ends():
    """Lower and upper ends of the rows, (2, P)."""
    return np.array([[row.low, row.high] for row in box().rows]).T


def column(name):
    return draws()[:, box().names.index(name)]


def nominal_with(**rows):
    values = box().nominal.copy()
    for name, value in rows.items():
        values[box().names.index(name)] = value
    return box().configured(values)


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_ranges_are_even_on_their_scale(scale):
    for i, name in enumerate(box().names):
        if box().rows[i].scale != scale:
            continue
        bend = np.log if scale == "log" else np.asarray
        low, high, values = *bend(ends()[:, i]), bend(column(name))
        counts, _ = np.histogram((values - low) / (high - low), bins=8, range=(0.0, 1.0))
        # A Sobol sequence puts the same number into each eighth; an edge may round either way.
        assert abs(counts - DRAWS / 8).max() <= 1, name
        assert counts.sum() == DRAWS


def test_choices_are_equally_frequent():
    for i, row in enumerate(box().rows):
        counts = [np.count_nonzero(draws()[:, i] == value) for value in row.choices]
        assert sum(counts) == (DRAWS if row.choices else 0)
        assert all(abs(count - DRAWS / len(row.choices)) <= 2 for count in counts), row.name


@pytest.mark.parametrize("cuts", [[0, 32, 64, 96, 128], [0, 1, 7, 100, 128], [0, 127, 128]])
def test_points_do_not_depend_on_how_blocks_are_cut(cuts):
    whole = box().points(3, 2, 0, 128)
    blocks = [box().points(3, 2, first, last - first) for first, last in pairwise(cuts)]
    np.testing.assert_array_equal(np.concatenate(blocks), whole)


def test_rows_that_act_under_readings_alone_move_no_other():
    always = len(box().names) - len(UNDER_READINGS)
    assert set(box().names[always:]) == set(UNDER_READINGS)
    engine = qmc.Sobol(always, scramble=True, seed=np.random.default_rng([3, 2]))
    points = box().points(3, 2, 0, 128)
    np.testing.assert_array_equal(points[:, :always], engine.random(128))
    # Nor do they repeat one of the others.
    near = np.abs(np.corrcoef(box().points(1, 0, 0, 1024).T)[always:, :always])
    assert near.max() < 0.2
    values = draws()[0].copy()
    values[always:] = ends()[1, always:]
    assert box().configured(values).seed == drawn(0).seed


def test_starts_apart_are_those_of_the_draw_within_the_half_plane():
    values = draws()[0].copy()
    apart, names = parse_reading("starts=apart"), box().names
    for posture, expected in ((30.0, [-2.0, 1.5]), (1.0, [-0.5, 0.0]), (2.0, [-1.5, 1.0])):
        values[names.index("posture")] = np.deg2rad(posture)
        values[names.index("offset_controller_2_joint_2")] = np.deg2rad(-2.0)
        values[names.index("offset_controller_2_joint_3")] = np.deg2rad(1.5)
        config = under(apart, box().configured(values), box().named(values))
        found = np.rad2deg(config.runs["controller_2"].start_offset.si)
        np.testing.assert_allclose(found, expected, atol=1e-9)
    list(build_loops(config, box().loaded.base.folder))


def test_a_ramp_has_the_amplitude_and_times_of_its_draw():
    named = box().named(draws()[5])
    config = under(parse_reading("motion=ramp"), drawn(5), named)
    reference = config.reference
    assert (reference.kind, reference.periods.si) == ("ramp", 2.0)
    np.testing.assert_allclose(reference.amplitude.si, [named["amplitude"]] * 2)
    assert reference.rise.si == pytest.approx(named["rise"], abs=0.005)
    assert type(reference).model_validate(reference.model_dump()) == reference


def test_replicates_and_seeds_are_scrambled_on_their_own():
    points = [box().points(seed, replicate, 0, 8) for seed, replicate in [(1, 0), (1, 1), (2, 0)]]
    assert not np.isclose(points[0], points[1]).any(axis=1).all()
    assert not np.isclose(points[0], points[2]).any(axis=1).all()
    np.testing.assert_array_equal(points[0], box().points(1, 0, 0, 8))


def test_firm_population_holds_rows_of_low_confidence():
    asked = ["populations.box.confidences=[high, medium]"]
    firm = load_study(None, asked, None, "printed").population
    values = firm.sample(1, 0, 0, 64)
    for i, row in enumerate(firm.rows):
        if row.confidence == "low":
            np.testing.assert_array_equal(values[:, i], row.nominal)
        else:
            assert np.unique(values[:, i]).size > 1, row.name
    assert "low" in {row.confidence for row in firm.rows}


def test_widest_draws_stay_in_the_workspace():
    for motion in range(len(WORDS["motion"])):
        for posture in ends():
            config = nominal_with(
                motion=motion,
                posture=posture[box().names.index("posture")],
                amplitude=ends()[1, box().names.index("amplitude")],
            )
            list(build_loops(config, box().loaded.base.folder))


def test_stiffness_at_the_joints_is_what_was_drawn():
    config = nominal_with(tendon_stiffness_2=111.0, tendon_stiffness_3=22.0, tendon_damping_3=0.7)
    drive = build_drive(config)
    # S_invᵀ diag(k) S_inv: joint 2 feels its own tendon, and tendon 3 at a radius of 17.5 mm.
    stiffness = drive.S_inv.T @ np.diag(drive.stiffness) @ drive.S_inv
    assert stiffness[1, 1] == pytest.approx(22.0)
    assert stiffness[0, 0] == pytest.approx(111.0 + 22.0 * (35.0 / 37.0) ** 2)
    assert drive.damping[1] == pytest.approx(0.7)


def test_inertias_and_links_follow_from_what_was_drawn():
    config = nominal_with(rotor_inertia=4e-6, reducer_inertia=5e-6, drum_inertia=3e-5)
    np.testing.assert_allclose(build_drive(config).inertia, 0.09 + 3e-5)
    config = nominal_with(link_length_2=0.3, link_mass_2=0.5, link_com_2=0.4, link_inertia_2=0.1)
    links = config.manipulator.links
    assert links.com.si[1] == pytest.approx(0.12)
    assert links.inertia.si[1] == pytest.approx(0.1 * 0.5 * 0.09)


@pytest.mark.parametrize(("sides", "link", "winch"), [(0, 0, 0), (1, 1, 0), (2, 0, 1), (3, 1, 1)])
def test_sides_of_friction(sides, link, winch):
    plant = build_plant(nominal_with(friction_sides=sides, link_coulomb=0.1, winch_coulomb=2.0), 0.0)
    np.testing.assert_allclose(plant.link_friction.coulomb, 0.1 * link)
    assert (plant.link_friction.viscous > 0.0).all() == bool(link)
    np.testing.assert_allclose(plant.drive.friction.coulomb, 2.0 * winch)
    assert (plant.drive.friction.viscous > 0.0).all()


def test_effects_outside_the_equations_are_off_unless_drawn():
    switches = ("pulley_loss_acts", "reducer_loss_acts", "torque_noise_acts", "transmission_error_acts")
    for config, values in (
        (nominal_with(), [0.0, 1.0, 0.0, 0.0]),
        (nominal_with(**dict.fromkeys(switches, 1)), [0.032, 0.7, 0.1, 3e-4]),
    ):
        friction, actuator = config.manipulator.friction, config.manipulator.actuator
        wobble = config.manipulator.transmission_error.peak_to_peak
        found = [friction.per_pulley, friction.reducer_efficiency, actuator.torque_noise, wobble]
        assert [quantity.si for quantity in found] == pytest.approx(values)
    assert nominal_with().manipulator.actuator.torque_resolution.si == 0.0


def test_unequal_motion_moves_joint_2_two_thirds_as_far():
    config = nominal_with(motion=WORDS["motion"].index("unequal"))
    loops = dict(build_loops(config, box().loaded.base.folder))
    peak = np.rad2deg(loops["controller_1"].reference.q_d.max(axis=0))
    np.testing.assert_allclose(peak, [28.0 * 2.0 / 3.0, 28.0], rtol=1e-3)


def test_noise_differs_between_draws_and_repeats_within_one():
    again = box().configured(draws()[0])
    assert again == drawn(0)
    assert len({drawn(k).seed.si for k in range(64)}) == 64
