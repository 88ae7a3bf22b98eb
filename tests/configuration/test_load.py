"""Loading: the shipped files, where a configuration comes from, overrides, hashes, copies and the schema."""

from __future__ import annotations

import hashlib
import io
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from tendonrepro.configuration.any_kind import checked, init_config, json_schema
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import CompareConfig, load_config, shipped_folder
from tendonrepro.configuration.quantity import Quantity
from tendonrepro.errors import ConfigError, UsageError

EXPERIMENTS = ("compare", "decouple")


@pytest.fixture(scope="module")
def compare() -> CompareConfig:
    config = load_config(None, "compare").config
    assert isinstance(config, CompareConfig)
    return config


# ---- what the shipped files say ----------------------------------------------------------------------------


def test_printed_numbers(compare: CompareConfig) -> None:
    routing, gains = compare.manipulator.routing, compare.control.gains
    assert routing.winch_diameter.value == (37, 37, 37)
    assert routing.pulley_diameter.value == ((77, 35, 35), (0, 77, 35), (0, 0, 37))
    printed = {"M_bar": (0.01,) * 2, "lam": (8, 8), "b": (0.9,) * 2, "eta": (1.5,) * 2, "Delta": (0.2,) * 2,
               "alpha": (0.1, 0.2), "beta": (2, 2)}  # fmt: skip
    assert {name: getattr(gains, name).value for name in printed} == printed
    assert all(getattr(gains, name).source.startswith("printed: ") for name in printed)
    c = routing.sign.si
    assert (c[0, 1], c[0, 2], c[1, 2]) == (1, -1, 1)
    assert compare.sampling_period.si == 0.001
    assert compare.manipulator.encoders.joint.resolution.value == 0.022
    assert [compare.runs[name].payload.si for name in compare.runs] == [0, 0, 0, 0.2]


# ---- where a configuration comes from ----------------------------------------------------------------------


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_way_to_the_same_configuration(
    experiment: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shipped = load_config(None, experiment)
    path = shipped_folder() / f"{experiment}.yaml"
    monkeypatch.chdir(tmp_path)
    copy = tmp_path / "copy.yaml"
    copy.write_text(shipped.yaml_text, encoding="utf-8")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(shipped.yaml_text.encode())))
    ways = [load_config(source, experiment) for source in (experiment, path, str(path), copy, "-")]
    assert [way.config for way in ways] == [shipped.config] * 5
    assert {way.sha256 for way in ways} == {shipped.sha256}
    assert {way.yaml_text for way in ways} == {shipped.yaml_text}
    assert shipped.origin == experiment
    assert [way.origin for way in ways] == [experiment, str(path), str(path), str(copy), "<stdin>"]
    assert shipped.inputs == (path, shipped_folder() / "lumidouce_ii.yaml")
    assert [way.inputs for way in ways[3:]] == [(copy,), ()]
    assert [way.folder for way in ways[3:]] == [tmp_path, tmp_path]


def test_hash_sees_values_and_sources_but_not_layout(tmp_path: Path) -> None:
    init_config("compare", tmp_path)
    path = tmp_path / "compare.yaml"
    before = load_config(path, "compare").sha256
    text = path.read_text()
    path.write_text("# a remark\n" + text.replace("value:  [8, 8]", "value: [8.0, 0.8e1]"))
    assert load_config(path, "compare").sha256 == before
    path.write_text(text.replace("value:  [8, 8]", "value:  [8, 7]"))
    assert load_config(path, "compare").sha256 != before
    path.write_text(text.replace("whose half it is", "half of it"))
    assert load_config(path, "compare").sha256 != before


MOTION = "time_s,q2_deg,q3_deg\n0,0,0\n1,4,2\n2,15,9\n3,26,18\n4,30,22\n5,30,22\n"


@pytest.fixture
def two_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The current folder, and one of configurations, each with an arm and a motion of its own."""
    here, there = tmp_path / "here", tmp_path / "there"
    init_config("compare", there)
    here.mkdir()
    arm = (there / "lumidouce_ii.yaml").read_text()
    for folder, gravity in ((here, "9.80"), (there, "9.82")):
        (folder / "arm.yaml").write_text(arm.replace("9.81", gravity))
        (folder / "motion.csv").write_text(MOTION.replace("4,30", f"4,{gravity}"))
    monkeypatch.chdir(here)
    return here, there


def gravity_of(source: Path | str | None, *overrides: str) -> float:
    return float(load_config(source, "compare", overrides=overrides).config.manipulator.gravity.si)


def test_an_arm_that_the_command_line_names_is_looked_for_here_first(two_folders: tuple[Path, Path]) -> None:
    here, there = two_folders
    named = "manipulator=arm.yaml"
    assert gravity_of(None, named) == gravity_of(there / "compare.yaml", named) == 9.80
    (here / "arm.yaml").unlink()
    assert gravity_of(there / "compare.yaml", named) == 9.82
    (there / "arm.yaml").unlink()
    with pytest.raises(ConfigError) as raised:
        load_config(there / "compare.yaml", "compare", overrides=[named])
    assert raised.value.where == "--set manipulator"
    assert all(str(folder / "arm.yaml") in str(raised.value.hint) for folder in (there, shipped_folder()))
    assert gravity_of(None, "manipulator=lumidouce_ii.yaml") == 9.81


def test_a_motion_that_the_command_line_names_is_looked_for_here_first(
    two_folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    here, there = two_folders
    overrides = ["reference={kind: sampled, file: motion.csv}"]
    further = ["reference={kind: sampled, file: none}", "reference.file=motion.csv"]
    assert load_config(there / "compare.yaml", "compare", overrides=further).inputs[-1] == here / "motion.csv"
    loaded = load_config(there / "compare.yaml", "compare", overrides=overrides)
    assert loaded.inputs[-1] == here / "motion.csv"
    # What is recorded runs again anywhere, and the digest knows the motion, not its place.
    (tmp_path / "again.yaml").write_text(loaded.yaml_text)
    monkeypatch.chdir(there)
    assert load_config(tmp_path / "again.yaml", "compare").inputs[-1] == here / "motion.csv"
    assert load_config("compare", "compare", overrides=overrides).sha256 != loaded.sha256
    (there / "motion.csv").write_text((here / "motion.csv").read_text())
    assert load_config("compare", "compare", overrides=overrides).sha256 == loaded.sha256


# ---- base --------------------------------------------------------------------------------------------------


def test_a_base_has_the_keys_that_a_file_leaves_out(compare: CompareConfig) -> None:
    loaded = load_config("compare_cosine", None)
    config = loaded.config
    assert isinstance(config, CompareConfig)
    assert config.reference.kind == "raised_cosine"
    assert config.title != compare.title
    same = {"title": compare.title, "reference": compare.reference}
    assert config.model_copy(update=same) == compare
    assert [path.name for path in loaded.inputs] == [
        "compare_cosine.yaml",
        "compare.yaml",
        "lumidouce_ii.yaml",
    ]


def with_base(folder: Path, text: str) -> Path:
    for name in ("compare", "decouple"):
        init_config(name, folder)
    path = folder / "mine.yaml"
    path.write_text(f"schema_version: 1\nexperiment: compare\n{text}", encoding="utf-8")
    return path


def test_mistakes_of_a_base_have_its_own_lines(tmp_path: Path) -> None:
    path = with_base(tmp_path, "base: compare.yaml\ntitle: ''\n")
    base = tmp_path / "compare.yaml"
    text = base.read_text(encoding="utf-8")
    base.write_text(text.replace("      value:  [8, 8]", "      value:  [-8, 8]"), encoding="utf-8")
    line = text[: text.index("      value:  [8, 8]")].count("\n") + 1
    with pytest.raises(ConfigError) as raised:
        load_config(path, "compare")
    assert f"{path}:4: title: must not be empty" in str(raised.value)
    assert f"{base}:{line}: control.gains.lam.value.0: must be above 0" in str(raised.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("base: decouple.yaml\n", "decouple.yaml.*'compare'"),
        ("base: ../compare.yaml\n", "beside this one or a shipped one"),
    ],
)
def test_a_base_that_cannot_be(tmp_path: Path, text: str, message: str) -> None:
    path = with_base(tmp_path, text)
    with pytest.raises(ConfigError, match=f"base: .*{message}") as raised:
        load_config(path, "compare")
    assert raised.value.where == f"{path}:3"


# ---- overrides ---------------------------------------------------------------------------------------------


def changed(*overrides: str, **options: Any) -> CompareConfig:
    config = load_config(None, "compare", overrides=overrides, **options).config
    assert isinstance(config, CompareConfig)
    return config


@pytest.mark.parametrize(("override", "path", "value"), [
    ("control.gains.lam=[6, 7]", "control.gains.lam", (6, 7)),
    ("control.gains.lam.value.1=7", "control.gains.lam", (8, 7)),
    ("manipulator.routing.pulley_diameter.value.0.2=30", "manipulator.routing.pulley_diameter",
     ((77, 35, 30), (0, 77, 35), (0, 0, 37))),
    (" control.gains.b = [.5, .6]", "control.gains.b", (0.5, 0.6)),
    ("control.gains.lam=6", "control.gains.lam", (6, 6)),
])  # fmt: skip
def test_value_set_on_the_command_line_says_so(override: str, path: str, value: object) -> None:
    quantity: Any = changed(override)
    for key in path.split("."):
        quantity = getattr(quantity, key)
    assert isinstance(quantity, Quantity)
    assert quantity.value == value
    assert quantity.source == "assumed: set on the command line"


@pytest.mark.parametrize("order", [1, -1])
def test_source_given_by_hand_is_kept_and_a_unit_loses_it(order: int) -> None:
    overrides = ["manipulator.gravity=1.62", "manipulator.gravity.source='assumed: on the Moon'"][::order]
    gravity = changed(*overrides).manipulator.gravity
    assert (gravity.si, gravity.source) == (1.62, "assumed: on the Moon")
    posture = changed(*["posture.unit=rad", "posture.value.0=0.5"][::order]).posture
    assert (posture.si[0], posture.source) == (0.5, "assumed: set on the command line")


def test_whole_sections_and_words() -> None:
    payload = "{value: 1, unit: kg, source: 'assumed: x'}"
    config = changed(
        "control.readings.phi_branch=power",
        "disturbance={kind: none}",
        f"runs.extra={{law: tdc, payload: {payload}}}",
    )
    assert (config.control.readings.phi_branch, config.disturbance.kind) == ("power", "none")
    assert list(config.runs)[-1] == "extra"


@pytest.mark.parametrize(("override", "where", "message"), [
    ("control.gians.lam=9", "--set control.gians.lam", "unknown key 'gians', did you mean 'gains'?"),
    ("alpha=[0, 0]", "--set alpha", "unknown key 'alpha', did you mean 'control.gains.alpha'?"),
    ("payload=0.5", "--set payload", "did you mean 'runs.controller_1.payload' or"),
    ("pulley_diameter.0.0=9", "--set pulley", "'manipulator.routing.pulley_diameter.value.0.0'?"),
    ("control.gains.lam.1=9", "--set control.gains.lam.1", "unknown key '1', did you mean 'value.1'?"),
    ("control.gains.lam.value.2=9", "--set control.gains.lam.value.2", "no entry 2 in a list of 2"),
    ("title.x=9", "--set title.x", "nothing below it can be set"),
    ("title=[1", "--set title:", "not valid YAML"),
])  # fmt: skip
def test_override_that_cannot_be_applied(override: str, where: str, message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        changed(override)
    assert str(raised.value.where).startswith(where)
    assert message in raised.value.message


def test_a_wrong_seed_is_told_by_the_option_that_gave_it() -> None:
    with pytest.raises(ConfigError, match="\n--seed: "):
        load_config(None, "compare", seed=-1)
    with pytest.raises(ConfigError, match="\n--set seed: "):
        load_config(None, "compare", overrides=["seed=-1"])


def test_everything_set_is_recorded_and_reproduced_by_the_text(tmp_path: Path) -> None:
    before = load_config(None, "compare").sha256
    loaded = load_config(None, "compare", overrides=["manipulator.gravity=1"], seed=7, controllers=[3, 1])
    assert loaded.overrides == ("manipulator.gravity=1", "seed=7", "controllers=3,1")
    assert loaded.config.seed.value == 7
    assert loaded.config.seed.source == "assumed: set on the command line"
    assert list(loaded.config.runs) == ["controller_1", "controller_3", "controller_1_payload"]
    for kind, wrong in (("compare", [1, 4]), ("compare", []), ("decouple", [1])):
        with pytest.raises(UsageError):
            load_config(None, kind, controllers=wrong)
    path = tmp_path / "again.yaml"
    path.write_text(loaded.yaml_text, encoding="utf-8")
    assert load_config(path, "compare").sha256 == loaded.sha256
    assert load_config(None, "compare").sha256 == before, "the shipped tree is not changed"


# ---- copies and schema -------------------------------------------------------------------------------------


def test_a_copy_is_complete_has_its_name_and_overwrites_nothing(tmp_path: Path) -> None:
    written = init_config("compare", tmp_path / "new" / "mine.yaml")
    assert [path.name for path in written] == ["mine.yaml", "lumidouce_ii.yaml", "schema.json"]
    assert load_config(written[0], "compare").sha256 == load_config(None, "compare").sha256
    assert [path.name for path in init_config("decouple", tmp_path / "new")] == ["decouple.yaml"]
    written[1].write_text("mine")
    for name, out in (("decouple", "new"), ("compare", "new"), ("compare", "other/lumidouce_ii.yaml")):
        with pytest.raises(UsageError):
            init_config(name, tmp_path / out)
    with pytest.raises(UsageError, match="'compare'"):
        init_config("compair", tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == sorted(
        ["mine.yaml", "lumidouce_ii.yaml", "schema.json", "decouple.yaml"]
    )
    assert written[1].read_text() == "mine"


def test_schema_file_is_up_to_date() -> None:
    text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    shipped = (shipped_folder() / "schema.json").read_text(encoding="utf-8")
    assert hashlib.sha256(shipped.encode()).hexdigest() == hashlib.sha256(text.encode()).hexdigest(), (
        "write it again: tendonrepro config schema > configs/schema.json"
    )


def test_schema_states_units_and_limits_of_every_quantity() -> None:
    gains = json_schema("compare")["$defs"]["Gains"]["properties"]
    assert gains["b"]["properties"]["value"]["items"] == {
        "type": "number", "exclusiveMinimum": 0.0, "exclusiveMaximum": 1.0,
    }  # fmt: skip
    for definition in json_schema()["$defs"].values():
        assert definition["description"]
        for name, field in definition["properties"].items():
            if "value" in field.get("properties", {}):
                assert re.search(r"; unit \S", field["description"]), name


def test_an_override_is_one_of_the_kind_that_is_checked() -> None:
    masses = checked("lumidouce_ii", ["links.mass=3"]).config.links.mass.si
    assert set(masses) == {3.0}
    with pytest.raises(ConfigError):
        checked("lumidouce_ii", ["base.x=3"])
    assert checked("ensemble", ["base.seed=3"]).base.config.seed.si == 3


@pytest.mark.parametrize(
    ("overrides", "unread"),
    [
        (["control.reference_lag=20"], 1),
        (["control.reference_lag.value=20", "control.filter_cutoff=50"], 2),
        (["control.reference_lag=20", "control.readings.reference_acceleration=late"], 0),
        (["control.filter_cutoff=50", "control.readings.estimate_filter=acceleration"], 0),
        ([], 0),
    ],
)
def test_an_override_that_no_reading_reads_is_named(overrides: list[str], unread: int) -> None:
    assert len(load_config(None, "compare", overrides=overrides).remarks) == unread


# ---- plants to draw ----------------------------------------------------------------------------------------


def test_the_shipped_ensemble_is_of_the_comparison() -> None:
    loaded = load_ensemble(None)
    files = ["ensemble.yaml", "compare.yaml", "lumidouce_ii.yaml"]
    assert [path.name for path in loaded.base.inputs] == files
    assert loaded.compare == load_config(None, "compare").config


@pytest.mark.parametrize(
    "override",
    ["seed=2", "box.posture.high=60", "populations.box.confidences=[high]", "base.control.gains.lam=[7, 8]"],
)
def test_hash_covers_what_determines_results(override: str) -> None:
    changed = load_ensemble(None, overrides=[override])
    assert changed.sha256 != load_ensemble(None).sha256
    assert changed.base.overrides == (override,)


def test_an_ensemble_has_one_population() -> None:
    second = "populations.firm={confidences: [high], share: {value: 1, unit: '1', source: 'assumed: a test'}}"
    for override in (second, "populations.box.share=0.5"):
        with pytest.raises(ConfigError, match="populations"):
            load_ensemble(None, overrides=[override])


def test_a_seed_is_an_override() -> None:
    loaded = load_ensemble(None, seed=5)
    assert loaded.config.seed.si == 5
    assert loaded.base.overrides == ("seed=5",)


def test_a_base_on_the_command_line_must_be_a_comparison() -> None:
    for base in ("missing.yaml", "decouple.yaml"):
        with pytest.raises(ConfigError):
            load_ensemble(None, overrides=[f"base={base}"])


def test_motions_that_are_not_chosen_need_not_end_within_the_longest_run() -> None:
    chosen = {"box.motion.choices": ["minimum_jerk"], "longest_run": 22}
    assert load_ensemble(None, overrides=chosen).config.longest_run.si == 22.0


def test_base_must_have_the_four_runs(tmp_path: Path) -> None:
    mine = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8")
    mine = mine.replace("  controller_1_payload:", "  loaded:")
    (tmp_path / "mine.yaml").write_text(mine, encoding="utf-8")
    path, text = tmp_path / "ensemble.yaml", (shipped_folder() / "ensemble.yaml").read_text(encoding="utf-8")
    path.write_text(text.replace("base: compare.yaml ", "base: mine.yaml "), encoding="utf-8")
    with pytest.raises(ConfigError, match="controller_1_payload") as raised:
        load_ensemble(path)
    assert raised.value.where == f"{path}:{text[: text.index('base: compare')].count(chr(10)) + 1}"
