"""An arm that names a base: units, what is taken over, what follows, and every way to be wrong about it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import tendonrepro as tr
from tendonrepro.configuration.any_kind import LoadedArm, checked, init_arm
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments.loops import all_loops, run_views
from tendonrepro.physics.linear_loop import loop_matrix, stroke
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import simulate_batch

ARM = """\
base: plain_arm
joints: 2
links: {length: [0.3, 0.25], mass: [0.8, 0.4]}
routing: {winch_diameter: 40, pulley_diameter: [[60, 30], [0, 40]], sign: 1}
tendons: {axial_stiffness: 3.0e4}
"""
COMPARE = """\
schema_version: 1
experiment: compare
base: plain
manipulator: my_arm.yaml
joints: [1, 2]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "my_arm.yaml").write_text(ARM, encoding="utf-8")
    (tmp_path / "compare.yaml").write_text(COMPARE, encoding="utf-8")
    return tmp_path


def arm_of(folder: Path, text: str = ARM) -> Manipulator:
    (folder / "my_arm.yaml").write_text(text, encoding="utf-8")
    held = checked(str(folder / "my_arm.yaml"), ())
    assert isinstance(held, LoadedArm)
    return held.config


def refused(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as raised:
        arm_of(folder, text)
    assert raised.value.exit_code == 2
    return str(raised.value).replace(str(folder), "")


def test_bare_numbers_take_the_units_of_the_base(folder: Path) -> None:
    arm = arm_of(folder)
    assert arm.joints == 2
    np.testing.assert_allclose(arm.links.length.si, [0.3, 0.25])
    np.testing.assert_allclose(arm.routing.winch_diameter.si, [0.04, 0.04])
    np.testing.assert_allclose(arm.routing.pulley_diameter.si, [[0.06, 0.03], [0.0, 0.04]])
    np.testing.assert_array_equal(arm.routing.sign.value, [[1, 1], [0, 1]])
    np.testing.assert_array_equal(arm.tendons.axial_stiffness.si, [3e4, 3e4])
    assert arm.links.mass.source.startswith("user: ")


def test_what_is_left_out_is_marked_as_taken_over(folder: Path) -> None:
    tree: Any = checked(str(folder / "my_arm.yaml"), ()).tree
    assert tree["winches"]["viscous"] == {
        "value": [1.0, 1.0], "unit": "N m s rad-1", "source": "assumed: from plain_arm",
    }  # fmt: skip
    assert tree["actuator"]["output_delay"]["source"] == "assumed: from plain_arm"
    assert tree["name"] == "my_arm"


def test_centres_and_inertias_follow_lengths_and_masses(folder: Path) -> None:
    links = arm_of(folder).links
    np.testing.assert_allclose(links.com.si, 0.48 * links.length.si)
    np.testing.assert_allclose(links.inertia.si, 0.098 * links.mass.si * links.length.si**2)
    own = arm_of(folder, ARM.replace("mass: [0.8, 0.4]", "mass: [0.8, 0.4], com: [0.1, 0.1]")).links
    np.testing.assert_array_equal(own.com.si, [0.1, 0.1])
    np.testing.assert_allclose(own.inertia.si, links.inertia.si)


def test_they_follow_what_the_command_line_changes(folder: Path) -> None:
    """As if the file had said it."""
    changed = {"manipulator.links.length": [0.6, 0.25], "manipulator.links.mass.value.1": 0.9, "seed": 2}
    links: Any = load_config(folder / "compare.yaml", "compare", overrides=changed).config.manipulator.links
    written = arm_of(
        folder, ARM.replace("0.3, 0.25], mass: [0.8, 0.4]", "0.6, 0.25], mass: [0.8, 0.9]")
    ).links
    for name in ("length", "mass", "com", "inertia"):
        np.testing.assert_array_equal(getattr(links, name).si, getattr(written, name).si)
    kept = load_config(folder / "compare.yaml", "compare", overrides=changed | {"manipulator.links.com": 0.2})
    assert kept.config.manipulator.links.com.si.tolist() == [0.2, 0.2]


def test_more_joints_than_the_base_repeat_its_last_one(folder: Path) -> None:
    arm = arm_of(folder, "base: plain_arm\njoints: 5\n")
    np.testing.assert_allclose(arm.links.length.si, [0.3, 0.28, 0.2, 0.2, 0.2])
    # A tendon passes further joints as the base's last one passes those before its own.
    np.testing.assert_allclose(arm.routing.pulley_diameter.si[:, 4], [0.035, 0.035, 0.035, 0.035, 0.037])
    np.testing.assert_array_equal(np.tril(arm.routing.sign.si, -1), 0.0)


def test_an_arm_based_on_ones_own(folder: Path) -> None:
    (folder / "heavy.yaml").write_text("base: my_arm.yaml\nlinks: {mass: 2}\n", encoding="utf-8")
    heavy: Any = checked(str(folder / "heavy.yaml"), ()).config
    np.testing.assert_array_equal(heavy.links.mass.si, [2.0, 2.0])
    np.testing.assert_allclose(heavy.links.inertia.si, 0.098 * 2.0 * heavy.links.length.si**2)
    np.testing.assert_array_equal(heavy.tendons.axial_stiffness.si, [3e4, 3e4])


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("mass: [0.8, 0.4]", "mass: [0.8, 0.4, 0.2]", "my_arm.yaml:3: links.mass.value: must have 2 entries"),
        ("[0, 40]]", "[0, 40, 1]]", "my_arm.yaml:4: routing.pulley_diameter.value: must have 2 entries"),
        ("joints: 2", "joints: 9", "my_arm.yaml:2"),
        ("mass: [0.8, 0.4]", "inertia: -1", "my_arm.yaml:3: links.inertia.value.0"),
        ("sign: 1", "sign: [[1, 1], [0, 0]]", "my_arm.yaml:4: routing.sign.value.1.1"),
        ("base: plain_arm", "base: my_arm.yaml", "my_arm.yaml:1"),
        ("base: plain_arm", "base: compare.yaml", "my_arm.yaml:1"),
        ("mass: [0.8", "masss: [0.8", "my_arm.yaml:3: links: unknown key 'masss'"),
    ],
)
def test_mistakes_name_key_and_line(folder: Path, old: str, new: str, place: str) -> None:
    assert old in ARM
    assert place in refused(folder, ARM.replace(old, new))


def test_an_experiment_takes_its_base_for_as_many_joints(folder: Path) -> None:
    config = load_config(folder / "compare.yaml", "compare").config
    assert isinstance(config, CompareConfig)
    assert config.posture.value == (45, 0)
    assert config.control.gains.alpha.value == (0.1, 0.2)
    text = COMPARE.replace("[1, 2]", "[2]") + (
        "reference: {kind: minimum_jerk, amplitude: 20, rise: 2, hold: 1, periods: 1}\n"
        "control: {gains: {alpha: 0.3}, laws: {controller_1: {surface: ntsm, estimator: alpha_tde}}}\n"
        "runs:\n  mine: {law: controller_1, payload: 0.3}\n"
    )
    (folder / "compare.yaml").write_text(text, encoding="utf-8")
    one = load_config(folder / "compare.yaml", "compare").config
    assert isinstance(one, CompareConfig)
    assert one.control.gains.lam.value == (8,)
    assert one.control.gains.alpha.value == (0.3,)
    np.testing.assert_allclose(one.reference.amplitude.si, np.radians([20.0]))  # type: ignore[union-attr]
    assert (list(one.runs), list(one.control.laws)) == (["mine"], ["controller_1"])
    assert one.runs["mine"].payload.si == 0.3


def test_the_base_of_an_experiment_may_have_one_itself(folder: Path) -> None:
    """The second file leaves all to the first, whose base has the shipped ``compare.yaml`` as its own."""
    (folder / "compare.yaml").write_text(f"{COMPARE}posture: [30, 10]\n", encoding="utf-8")
    first = load_config(folder / "compare.yaml", "compare")
    second = folder / "second.yaml"
    second.write_text("experiment: compare\nbase: compare.yaml\ntitle: Second\n", encoding="utf-8")
    loaded = load_config(second, "compare")
    assert loaded.config == first.config.model_copy(update={"title": "Second"})
    assert loaded.inputs == (second, *first.inputs)
    second.write_text("experiment: compare\nbase: compare.yaml\njoints: [2]\nposture: 20\n", encoding="utf-8")
    alone = load_config(second, "compare").config
    assert isinstance(alone, CompareConfig)
    assert (alone.posture.value, alone.control.gains.lam.value) == ((20, 20), (8,))
    (folder / "compare.yaml").write_text("experiment: compare\nbase: second.yaml\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"base: no file 'second.yaml'") as raised:
        load_config(second, "compare")
    assert raised.value.where == f"{folder / 'compare.yaml'}:2"


def test_an_arm_inside_a_base_has_the_name_of_the_file_that_was_asked_for(folder: Path) -> None:
    inside = COMPARE.replace("my_arm.yaml", "{base: my_arm.yaml, links: {mass: 1}}")
    (folder / "compare.yaml").write_text(inside, encoding="utf-8")
    (folder / "second.yaml").write_text("experiment: compare\nbase: compare.yaml\n", encoding="utf-8")
    for name in ("compare", "second"):
        assert load_config(folder / f"{name}.yaml", "compare").config.manipulator.name == name


LINKS = ["mass", "length", "com", "inertia"]


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    key=st.sampled_from(["manipulator.links", *(f"manipulator.links.{name}" for name in LINKS)]),
    part=st.sampled_from(["", ".value", ".unit", ".source"]),
    wrong=st.sampled_from([[], [[1, 2], [0, 1]], [1, "x"], [-1, 0], {}, {"a": 1}, "abc", None, True, [None]]),
)
def test_links_that_cannot_be_are_told_before_anything_follows_them(
    folder: Path, key: str, part: str, wrong: Any
) -> None:
    with pytest.raises(ConfigError) as raised:
        load_config(folder / "compare.yaml", "compare", overrides={key + part: wrong})
    assert f"--set {key}" in str(raised.value)


def test_an_experiment_with_a_base_has_to_say_which_it_is(folder: Path) -> None:
    (folder / "compare.yaml").write_text("base: compare.yaml\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"compare.yaml:1: experiment"):
        load_config(folder / "compare.yaml", "compare")


@pytest.mark.parametrize(
    "joints", [1, 2, 3, 4, pytest.param(5, marks=pytest.mark.slow), pytest.param(6, marks=pytest.mark.slow)]
)
def test_a_new_arm_is_stable_in_the_comparison_that_comes_with_it(tmp_path: Path, joints: int) -> None:
    written = init_arm(joints, tmp_path / "my_arm.yaml")
    assert [path.name for path in written] == ["my_arm.yaml", "compare.yaml", "decouple.yaml", "schema.json"]
    config: Any = load_config(tmp_path / "compare.yaml", "compare").config
    assert len(config.joints) == joints
    loop = next(iter(all_loops(load_config(tmp_path / "compare.yaml", "compare")).values()))
    for view in run_views(config).values():
        for q in stroke(loop.reference.q_d):
            matrix = loop_matrix(q, view.plant, view.law, view.delay)
            assert abs(np.linalg.eigvals(matrix)).max() < 0.9999
    start = {name: getattr(loop.reference, name)[:64] for name in ("time", "q_d", "dq_d", "ddq_d")}
    short = replace(loop, reference=replace(loop.reference, **start))
    resolved = simulate_batch([short]).status != STATUSES.index("unresolved")
    assert resolved.all(), "the compiled stepper follows it"


@pytest.mark.slow
def test_the_angles_of_a_new_arm_follow_from_its_motors(tmp_path: Path) -> None:
    init_arm(2, tmp_path)
    result = tr.decouple(tmp_path / "decouple.yaml")
    assert result["decouple"].joint.values.tolist() == [1, 2]
    assert result["decouple"].attrs["status"] == "ok"


def test_a_new_arm_overwrites_nothing(tmp_path: Path) -> None:
    init_arm(2, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    beside = tmp_path / "new"
    wrong = ((2, tmp_path), (2, tmp_path / "other.yaml"), (7, beside), (0, tmp_path))
    for joints, out in (*wrong, (2, beside / "compare.yaml")):  # the experiment has that name
        with pytest.raises(UsageError):
            init_arm(joints, out)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_tendon_may_pass_a_joint_without_a_pulley(folder: Path) -> None:
    """Zeros above the diagonal uncouple the joints."""
    arm, path = folder / "my_arm.yaml", folder / "compare.yaml"
    arm.write_text(ARM.replace("[[60, 30], [0, 40]], sign: 1", "[[60, 0], [0, 40]], sign: 1"), "utf-8")
    loaded = load_config(path, "compare")
    for view in run_views(loaded.config).values():
        assert view.plant.drive.S_inv == pytest.approx(np.diag([60 / 40, 40 / 40]))
