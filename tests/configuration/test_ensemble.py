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


def test_seed_and_overrides_of_the_base() -> None:
    loaded = load_ensemble(None, overrides=["base.control.gains.lam=[7, 8]"], seed=5)
    assert loaded.config.seed.si == 5
    assert loaded.base.overrides == ("base.control.gains.lam=[7, 8]", "seed=5")
    assert loaded.compare.control.gains.lam.value == (7.0, 8.0)


MISTAKES = [
    ("link_mass_2:", "link_mas_2:", "unknown key 'link_mas_2', did you mean 'link_mass_2'"),
    ("low: 40, ", "low: 4000, ", "tendon_stiffness_2.low: must be below high, 2000, found 4000"),
    ("nominal: 280,", "nominal: 15,", "nominal: must be from 40 to 2000, found 15"),
    ("nominal: 280,", "nominal: 2001,", "nominal: must be from 40 to 2000, found 2001"),
    ("low: 40, ", "low: 2000, ", "tendon_stiffness_2.low: must be below high, 2000, found 2000"),
    ("12, scale: linear, unit: s", "12, scale: linear, unit: m", "box.period.unit: must be s or ms, found"),
    ("low: 0.55,", "low: -1,", "reducer_efficiency.low: must be above 0"),
    ("[none, sine, noise]", "[none, sinus]", "must be one of none, sine, noise, found 'sinus'"),
    ("[0, 1, 2], nominal: 0", "[1, 2], nominal: 0", "one of the choices, 1.0, 2.0"),
    ("differencing=centred, output_delay=1", "difference=x, output_delay=1", "no axis of readings"),
    ("[error_rate=low_pass, encoder=0.088]", "[M_bar=halved]", "variation, not a reading"),
    ("- sampling_period=0.5ms", "- sampling_period=3ms", "must be one of"),
    ("value:  32", "value:  33", "block.value: must be a power of two, found 33"),
    ("high: 45, scale", "high: 46, scale", "must keep link 3 below 180 deg from hanging, it would reach 181"),
    ("value:  30\n", "value:  20\n", "longest_run.value: must cover every motion"),
    ("datasheet: 4.4e-4", "somewhere: 4.4e-4", "must begin with printed:"),
]


@pytest.mark.parametrize(("old", "new", "message"), MISTAKES, ids=[new for _, new, _ in MISTAKES])
def test_mistakes_name_their_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = written(tmp_path, (old, new))
    with pytest.raises(ConfigError, match=message) as raised:
        load_ensemble(path)
    assert f"{path}:{line_of(old)}: " in str(raised.value)
    assert "1 mistake" in str(raised.value)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["base=missing.yaml"], "base: no file 'missing.yaml'"),
        (["base=decouple.yaml"], "experiment: must be compare, found"),
        (["base.control.gains.lam=[-1, 8]"], "control.gains.lam.value.0: must be above 0"),
        (["box.posture.low=70"], "box.posture.nominal: must be from 70 to 89"),
    ],
)
def test_mistakes_on_the_command_line(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_ensemble(None, overrides=overrides)


def test_base_must_have_the_four_runs(tmp_path: Path) -> None:
    mine = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8")
    mine = mine.replace("  controller_1_payload:", "  loaded:")
    (tmp_path / "mine.yaml").write_text(mine, encoding="utf-8")
    path = written(tmp_path, ("base: compare.yaml ", "base: mine.yaml "))
    with pytest.raises(ConfigError, match="controller_1_payload") as raised:
        load_ensemble(path)
    assert raised.value.where == f"{path}:{line_of('base: compare')}"
