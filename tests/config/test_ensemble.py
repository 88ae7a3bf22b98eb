"""The ensemble's configuration: every mistake with its line, and a hash of all that matters."""

from __future__ import annotations

from pathlib import Path

import pytest

from tendonrepro.config.ensemble import load_ensemble
from tendonrepro.config.load import CompareConfig
from tendonrepro.config.shipped import init_config, shipped_folder
from tendonrepro.errors import ConfigError, UsageError

TEXT = (shipped_folder() / "ensemble.yaml").read_text(encoding="utf-8")


def written(folder: Path, old: str, new: str) -> Path:
    assert TEXT.count(old) == 1, old
    path = folder / "ensemble.yaml"
    path.write_text(TEXT.replace(old, new), encoding="utf-8")
    return path


def line_of(text: str, path: Path) -> int:
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(number for number, line in enumerate(lines, start=1) if text in line)


def test_shipped_file_loads() -> None:
    loaded = load_ensemble(None)
    assert loaded.origin == "ensemble"
    assert loaded.overrides == ()
    assert [path.name for path in loaded.inputs] == ["ensemble.yaml", "compare.yaml", "lumidouce_ii.yaml"]
    assert loaded.config.scramblings.si >= 8
    assert isinstance(loaded.base.config, CompareConfig)
    assert list(loaded.config.populations) == ["box", "firm"]


def test_shipped_text_is_made_to_be_read() -> None:
    assert max(map(len, TEXT.splitlines())) <= 120
    assert "\t" not in TEXT
    assert all(row.source.isprintable() for _, row in load_ensemble(None).config.box.items())


def test_yaml_text_loads_to_the_same(tmp_path: Path) -> None:
    loaded = load_ensemble(None, overrides=["box.posture.high=60"])
    copy = tmp_path / "copy.yaml"
    copy.write_text(loaded.yaml_text, encoding="utf-8")
    again = load_ensemble(copy)
    assert again.config == loaded.config
    assert again.sha256 == loaded.sha256


@pytest.mark.parametrize(
    "override",
    ["seed=2", "box.posture.high=60", "populations.firm.share=0.5", "base.control.gains.lam=[7, 8]"],
)
def test_hash_covers_what_determines_results(override: str) -> None:
    changed = load_ensemble(None, overrides=[override])
    assert changed.sha256 != load_ensemble(None).sha256
    assert changed.overrides == (override,)


def test_a_copy_is_complete_and_the_same(tmp_path: Path) -> None:
    written = [path.name for path in init_config("ensemble", tmp_path)]
    assert written == ["ensemble.yaml", "schema.json", "compare.yaml", "lumidouce_ii.yaml"]
    copied = load_ensemble(tmp_path / "ensemble.yaml")
    assert copied.sha256 == load_ensemble(None).sha256
    assert {path.parent for path in copied.inputs} == {tmp_path}


def test_seed_and_overrides_of_the_base() -> None:
    loaded = load_ensemble(None, overrides=["base.control.gains.lam=[7, 8]"], seed=5)
    assert loaded.config.seed.si == 5
    assert loaded.overrides == ("base.control.gains.lam=[7, 8]", "seed=5")
    assert loaded.compare.control.gains.lam.value == (7.0, 8.0)


def test_base_may_stand_beside_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "base: compare.yaml ", "base: mine.yaml ")
    mine = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8").replace("[8, 8]", "[6, 6]")
    (tmp_path / "mine.yaml").write_text(mine, encoding="utf-8")
    loaded = load_ensemble(path)
    assert loaded.compare.control.gains.lam.value == (6.0, 6.0)


MISTAKES = [
    ("  link_mass_2:", "  link_mas_2:", "link_mas_2", "unknown key 'link_mas_2', did you mean 'link_mass_2'"),
    (
        "{low: 40, ",
        "{low: 4000, ",
        "low: 4000",
        "tendon_stiffness_2.low: must be below high, 2000, found 4000",
    ),
    ("nominal: 150,", "nominal: 15,", "nominal: 15,", "nominal: must be from 40 to 2000, found 15"),
    ("{low: 5, nominal: 20", "{low: 0, nominal: 20", "{low: 0, nominal: 20", "above 0 on a log scale"),
    (
        "high: 12, scale: linear, unit: s",
        "high: 12, scale: linear, unit: m",
        "high: 12,",
        "box.period.unit: must be s or ms, found",
    ),
    ("{low: 0.55,", "{low: -1,", "{low: -1,", "reducer_efficiency.low: must be at least"),
    ("high: 0.85,", "high: 1.85,", "high: 1.85,", "reducer_efficiency.high: must be at least"),
    (
        "[none, sine, noise]",
        "[none, sinus]",
        "[none, sinus]",
        "must be one of none, sine, noise, found 'sinus'",
    ),
    (
        "choices: [0, 1, 2], nominal: 1",
        "choices: [0, 2], nominal: 1",
        "[0, 2]",
        "one of the choices, 0.0, 2.0",
    ),
    ("choices: [0, 1, 2]", "choices: [0, 1, 1]", "[0, 1, 1]", "must not name a choice twice"),
    (
        "differencing=centred, output_delay=1",
        "difference=x, output_delay=1",
        "difference=x",
        "no axis of readings",
    ),
    ("error_rate=low_pass, encoder=0.088", "error_rate=low, encoder=0.088", "error_rate=low,", "not 'low'"),
    (
        "[error_rate=low_pass, encoder=0.088]",
        "[M_bar=halved]",
        "- [M_bar=halved]",
        "variation, not a reading",
    ),
    (
        "variations: [sampling_period=0.5ms",
        "variations: [sampling_period=3ms",
        "variations:",
        "must be one of",
    ),
    ("value:  32", "value:  33", "value:  33", "block.value: must be a power of two, found 33"),
    (
        "high: 45, scale",
        "high: 46, scale",
        "high: 46, scale",
        "must keep link 3 below 180 deg from hanging, it would reach 181",
    ),
    ("value:  30\n", "value:  20\n", "value:  20", "longest_run.value: must cover every motion"),
    ("datasheet: 4.4e-4", "somewhere: 4.4e-4", "somewhere: 4.4e-4", "must begin with its origin"),
    ("experiment: ensemble", "experiment: ensembel", "experiment:", "experiment: must be ensemble, found"),
]


@pytest.mark.parametrize(("old", "new", "line", "message"), MISTAKES, ids=[new for _, new, _, _ in MISTAKES])
def test_mistakes_name_their_line(tmp_path: Path, old: str, new: str, line: str, message: str) -> None:
    path = written(tmp_path, old, new)
    with pytest.raises(ConfigError, match=message) as raised:
        load_ensemble(path)
    assert f"{path}:{line_of(line, path)}: " in str(raised.value)
    assert "1 mistake" in str(raised.value)


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    path = written(tmp_path, "{low: 40, ", "{low: 4000, ")
    path.write_text(path.read_text(encoding="utf-8").replace("value:  32", "value:  33"), encoding="utf-8")
    with pytest.raises(ConfigError, match="2 mistakes"):
        load_ensemble(path)


def test_a_missing_row_is_named(tmp_path: Path) -> None:
    start = TEXT.index("  tensioner_force:")
    end = TEXT.index("  transmission_error_acts:")
    path = tmp_path / "ensemble.yaml"
    path.write_text(TEXT[:start] + TEXT[end:], encoding="utf-8")
    with pytest.raises(ConfigError, match="box: missing key 'tensioner_force'"):
        load_ensemble(path)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["base=missing.yaml"], "base: no file 'missing.yaml'"),
        (["base=decouple.yaml"], "is for the experiment 'decouple'"),
        (["base.control.gains.lam=[-1, 8]"], "control.gains.lam.value.0: must be above 0"),
        (["box.posture.low=70"], "box.posture.nominal: must be from 70 to 89"),
    ],
)
def test_mistakes_on_the_command_line(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_ensemble(None, overrides=overrides)


def test_base_must_have_the_four_runs(tmp_path: Path) -> None:
    path = written(tmp_path, "base: compare.yaml ", "base: mine.yaml ")
    mine = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(
        mine.replace("  controller_1_payload:", "  loaded:"), encoding="utf-8"
    )
    with pytest.raises(ConfigError, match="has no run 'controller_1_payload'") as raised:
        load_ensemble(path)
    assert raised.value.where == f"{path}:{line_of('base: mine', path)}"


def test_another_experiment_is_refused() -> None:
    with pytest.raises(ConfigError, match="for the experiment 'compare', not 'ensemble'"):
        load_ensemble("compare")


def test_an_override_needs_a_value() -> None:
    with pytest.raises(UsageError, match="is not of the form key=VALUE"):
        load_ensemble(None, overrides=["seed"])
