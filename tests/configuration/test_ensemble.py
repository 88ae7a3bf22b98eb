"""The ensemble's configuration: every mistake with its line, and a hash of all that matters."""

from __future__ import annotations

from pathlib import Path

import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import CompareConfig, shipped_folder
from tendonrepro.errors import ConfigError

TEXT = (shipped_folder() / "ensemble.yaml").read_text(encoding="utf-8")


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    text = TEXT
    for old, new in changes:
        assert TEXT.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "ensemble.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def line_of(old: str) -> int:
    return TEXT[: TEXT.index(old)].count("\n") + 1


def test_shipped_file_loads() -> None:
    loaded = load_ensemble(None)
    assert loaded.origin == "ensemble"
    assert loaded.base.overrides == ()
    assert [path.name for path in loaded.base.inputs] == [
        "ensemble.yaml",
        "compare.yaml",
        "lumidouce_ii.yaml",
    ]
    assert loaded.config.scramblings.si >= 8
    assert isinstance(loaded.base.config, CompareConfig)
    assert list(loaded.config.populations) == ["box"]


@pytest.mark.parametrize(
    "override",
    ["seed=2", "box.posture.high=60", "populations.box.share=0.5", "base.control.gains.lam=[7, 8]"],
)
def test_hash_covers_what_determines_results(override: str) -> None:
    changed = load_ensemble(None, overrides=[override])
    assert changed.sha256 != load_ensemble(None).sha256
    assert changed.base.overrides == (override,)


def test_a_seed_is_an_override() -> None:
    loaded = load_ensemble(None, seed=5)
    assert loaded.config.seed.si == 5
    assert loaded.base.overrides == ("seed=5",)


MISTAKES = [
    ("low: 40, ", "low: 4000, ", "tendon_stiffness_2.low: must be below high, 2000, found 4000"),
    ("nominal: 280,", "nominal: 15,", "nominal: must be from 40 to 2000, found 15"),
    ("12, scale: linear, unit: s", "12, scale: linear, unit: m", "box.period.unit: must be s or ms, found"),
    ("low: 0.55,", "low: -1,", "reducer_efficiency.low: must be above 0"),
    ("[none, sine, noise]", "[none, sinus]", "must be one of none, sine, noise, found 'sinus'"),
    ("[0, 1, 2], nominal: 0", "[1, 2], nominal: 0", "one of the choices, 1.0, 2.0"),
    ("[error_rate=low_pass, encoder=0.088]", "[M_bar=halved]", "variation, not a reading"),
    ("value:  32", "value:  33", "block.value: must be a power of two, found 33"),
    ("high: 45, scale", "high: 46, scale", "must keep link 3 below 180 deg from hanging, it would reach 181"),
    ("value:  30\n", "value:  20\n", "longest_run.value: must cover every motion"),
]


@pytest.mark.parametrize(("old", "new", "message"), MISTAKES, ids=[new for _, new, _ in MISTAKES])
def test_mistakes_name_their_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = written(tmp_path, (old, new))
    with pytest.raises(ConfigError, match=message) as raised:
        load_ensemble(path)
    assert f"{path}:{line_of(old)}: " in str(raised.value)
    assert "1 mistake" in str(raised.value)


def test_a_base_on_the_command_line_must_be_a_comparison() -> None:
    for base in ("missing.yaml", "decouple.yaml"):
        with pytest.raises(ConfigError):
            load_ensemble(None, overrides=[f"base={base}"])


def test_the_slowest_strokes_end_within_the_longest_run() -> None:
    with pytest.raises(ConfigError, match="longest_run"):
        load_ensemble(None, overrides=["box.velocity.low=3"])


def test_motions_that_are_not_chosen_need_not_end_within_the_longest_run() -> None:
    chosen = {"box.motion.choices": ["minimum_jerk"], "longest_run": 22}
    assert load_ensemble(None, overrides=chosen).config.longest_run.si == 22.0


def test_base_must_have_the_four_runs(tmp_path: Path) -> None:
    mine = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8")
    mine = mine.replace("  controller_1_payload:", "  loaded:")
    (tmp_path / "mine.yaml").write_text(mine, encoding="utf-8")
    path = written(tmp_path, ("base: compare.yaml ", "base: mine.yaml "))
    with pytest.raises(ConfigError, match="controller_1_payload") as raised:
        load_ensemble(path)
    assert raised.value.where == f"{path}:{line_of('base: compare')}"
