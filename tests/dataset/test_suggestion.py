"""Suggested mappings: they load whatever the names are, and times stay those of the record."""

from __future__ import annotations

from collections.abc import Mapping as AnyMapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tendonrepro.config.fields.strict_yaml import load
from tendonrepro.config.published import coupling_of, published, table_1
from tendonrepro.dataset.mapping.assembly import Assembly, doubts_about
from tendonrepro.dataset.mapping.model import Mapping, load_mapping
from tendonrepro.dataset.mapping.suggestion import Suggestion, suggest
from tendonrepro.dataset.meaning.understand import understand
from tendonrepro.dataset.readers.signals import Found, Source
from tendonrepro.errors import ConfigError, TendonreproError

Array = NDArray[np.float64]
S, S_INV = coupling_of(table_1(published()))
TIME = 0.01 * np.arange(500.0)
COURSE = np.sin(TIME)
MOTORS = ("motor1", "motor2", "motor3")
LATE = COURSE - 1e-3 * np.cos(7.0 * TIME)

# Names as YAML could hold them: it has no way to write half of a pair, and the strict reader refuses NUL.
names = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=30)


def source(name: str, signals: AnyMapping[str, Array], **times: Array) -> Source:
    found = Found("SYNTHETIC")
    for path, values in signals.items():
        found.add(path, values, label=path.rpartition("/")[2], unit="rad", group="log", time=times.get(path))
    return Source(name, "SYNTHETIC", 0, "0" * 32, tuple(found.signals))


def suggested(*sources: Source) -> tuple[Suggestion, Mapping]:
    suggestion = suggest(understand(sources, S_INV), "SYNTHETIC")
    return suggestion, Mapping.model_validate(load(suggestion.text, "mapping.yaml").tree)


def duration(*sources: Source) -> float:
    _, mapping = suggested(*sources)
    assembly = Assembly(sources, mapping, "mapping.yaml", S, lambda time, _: ("ok", float(time[-1])))
    (run,) = assembly.runs().values()
    return float(run.time[-1])


@given(file=names, signal=names, title=names)
def test_any_name_can_be_suggested(file: str, signal: str, title: str) -> None:
    found = Found("SYNTHETIC")
    found.add(signal, COURSE, label="q2", unit="rad")
    columns = understand([Source(file, "SYNTHETIC", 0, "0" * 32, tuple(found.signals))], S_INV)
    suggestion = suggest(columns, title)
    mapping = Mapping.model_validate(load(suggestion.text, "mapping.yaml").tree)
    (run,) = mapping.runs.values()
    assert [(entry.file, entry.signal) for entry in run.signals] == [(file, signal)]
    assert mapping.title == title


@given(file=names, first=names, second=names)
def test_any_name_can_stand_in_a_comment(file: str, first: str, second: str) -> None:
    """In what is to be decided, and among the columns in no run."""
    found = Found("SYNTHETIC")
    for path, label, values in ((first, "q2", COURSE), (second, "q2", LATE), ("zz", second, LATE)):
        found.add(path, values, label=label, unit="rad")
    columns = understand([Source(file, "SYNTHETIC", 0, "0" * 32, tuple(found.signals))], S_INV)
    suggestion = suggest(columns, "SYNTHETIC")
    mapping = Mapping.model_validate(load(suggestion.text, "mapping.yaml").tree)
    assert all(entry.file == file for run in mapping.runs.values() for entry in run.signals)
    lines = suggestion.text.split("\n")
    body = lines[lines.index("") + 1 :]
    assert all(line.startswith("#") for line in lines[: lines.index("")])
    assert sum(line.startswith("    - variable: ") for line in body) == sum(suggestion.runs.values())


@pytest.mark.parametrize(
    "name", ["q2\x7f", "q2\x85", "q2\u2028x: 1", "\ufeffq2", "q2\n- x: y", "q2\U000e0001"]
)
def test_names_that_yaml_holds_only_escaped(name: str) -> None:
    suggestion, mapping = suggested(source("c1.csv", {"Time": TIME, name: COURSE}))
    (run,) = mapping.runs.values()
    assert [entry.signal for entry in run.signals] == [name]
    assert all(line.isprintable() for line in suggestion.text.split("\n"))


@pytest.mark.parametrize("name", ["q2\0", "q2\udcff"])
def test_a_name_that_no_mapping_holds_does_not_stop_the_others(name: str) -> None:
    suggestion, mapping = suggested(source("c1.csv", {"q2_d": COURSE, name: LATE}))
    (run,) = mapping.runs.values()
    assert {entry.signal for entry in run.signals} == {"q2_d", "q2\ufffd"}
    suggestion.text.encode()


class TestTimes:
    """A plain vector beside a timeseries in one run."""

    def test_the_vector_gets_the_step_of_the_timeseries(self) -> None:
        beside = source("controller1.mat", {"log/q2_d": COURSE, "log/q2": LATE}, **{"log/q2_d": TIME})
        suggestion, mapping = suggested(beside)
        assert duration(beside) == pytest.approx(4.99)
        assert not suggestion.remarks
        (run,) = mapping.runs.values()
        assert run.time is not None
        assert run.time.step_s == 0.01
        assert "log/q2_d" in (run.time.because or "")

    def test_a_gap_in_the_times_is_to_be_decided(self) -> None:
        time = np.append(TIME[:-1], np.inf)
        beside = source("controller1.mat", {"log/q2_d": COURSE, "log/q2": LATE}, **{"log/q2_d": time})
        assert any("log/q2 has no times" in remark for remark in suggested(beside)[0].remarks)

    @pytest.mark.parametrize("time", [TIME + 5.0, TIME**2])
    def test_times_that_are_no_even_steps_are_to_be_decided(self, time: Array) -> None:
        beside = source("controller1.mat", {"log/q2_d": COURSE, "log/q2": LATE}, **{"log/q2_d": time})
        suggestion, _ = suggested(beside)
        (remark,) = suggestion.remarks
        assert "log/q2 has no times" in remark
        assert "log/q2_d" in remark
        with pytest.raises(ConfigError, match="differ by up to"):
            duration(beside)

    def test_two_steps_beside_it_are_to_be_decided(self) -> None:
        signals = {"log/q2_d": COURSE, "log/q3_d": COURSE, "log/q2": LATE}
        beside = source("controller1.mat", signals, **{"log/q2_d": TIME, "log/q3_d": 2.0 * TIME})
        assert any("log/q2 has no times" in remark for remark in suggested(beside)[0].remarks)

    def test_another_length_is_no_witness(self) -> None:
        beside = source(
            "controller1.mat", {"log/q2_d": COURSE[:400], "log/q2": LATE}, **{"log/q2_d": TIME[:400]}
        )
        suggestion, mapping = suggested(beside)
        (run,) = mapping.runs.values()
        assert run.time is not None
        assert run.time.step_s == 0.001
        assert any("0.001 s is the paper's" in remark for remark in suggestion.remarks)

    def test_a_column_of_times_serves_what_has_none(self) -> None:
        signals = {"log/Time": TIME, "log/q2_d": COURSE, "log/q2": LATE}
        suggestion, mapping = suggested(source("controller1.mat", signals, **{"log/q2_d": TIME}))
        (run,) = mapping.runs.values()
        assert run.time is not None
        assert run.time.signal == "log/Time"
        assert not any("has no times" in remark for remark in suggestion.remarks)


class TestOwnTimes:
    """Columns of one run with different times."""

    def test_they_are_resampled_where_they_meet(self) -> None:
        """What is taken where both have samples is not changed by it."""
        signals = {"X1": TIME, "q2_d Y": COURSE, "X2": np.append(TIME[:400], np.full(100, np.nan))}
        signals["q2 Y"] = np.append(LATE[:400], np.full(100, np.nan))
        found = Found("SYNTHETIC")
        for path, values in signals.items():
            found.add(path, values, group="table")
        sources = [Source("c1.csv", "SYNTHETIC", 0, "0" * 32, tuple(found.signals))]
        suggestion, mapping = suggested(*sources)
        assert mapping.resample is not None
        assert mapping.resample.step_s == 0.01
        assert any("times of their own" in remark for remark in suggestion.remarks)
        (run,) = (
            Assembly(sources, mapping, "m.yaml", S, lambda time, _: ("ok", float(time[-1]))).runs().values()
        )
        np.testing.assert_allclose(
            run["q_d"][:, 0] / run["q_encoder"][:, 0], (COURSE / LATE)[:400], rtol=1e-9
        )

    @pytest.mark.parametrize("step", [0.01, 0.004])
    def test_clocks_that_do_not_meet_start_together(self, step: float) -> None:
        apart = [
            source("decoupling_a.csv", {"Time": TIME} | {f"q{k}": COURSE for k in (1, 2, 3)}),
            source("decoupling_b.csv", {"Time": 1e9 + step * np.arange(500.0)} | dict.fromkeys(MOTORS, LATE)),
        ]
        suggestion, mapping = suggested(*apart)
        assert (mapping.resample is None) == (step == 0.01)
        assert any("do not meet" in remark for remark in suggestion.remarks)
        assert duration(*apart) == pytest.approx(499.0 * step, abs=2e-6)


def test_a_table_in_long_form_is_assembled_as_it_was() -> None:
    found = Found("SYNTHETIC")
    signals = {
        "Time (s)": np.tile(TIME, 4),
        "controller": np.repeat([1.0, 1.0, 3.0, 3.0], len(TIME)),
        "joint": np.repeat([2.0, 3.0, 2.0, 3.0], len(TIME)),
        "measured (rad)": np.concatenate([k * LATE for k in (1.0, 0.9, 0.8, 0.7)]),
    }
    for name, values in signals.items():
        found.add(name, values, group="table")
    tidy = [Source("tidy.csv", "SYNTHETIC", 0, "0" * 32, tuple(found.signals))]
    _, mapping = suggested(*tidy)
    runs = Assembly(tidy, mapping, "mapping.yaml", S, lambda time, _: ("ok", float(time[-1]))).runs()
    assert list(runs) == ["controller_1", "controller_3"]
    np.testing.assert_array_equal(runs["controller_1"]["q_encoder"], np.stack([LATE, 0.9 * LATE], axis=1))
    np.testing.assert_array_equal(
        runs["controller_3"]["q_encoder"], np.stack([0.8 * LATE, 0.7 * LATE], axis=1)
    )


class TestRecordings:
    """Several recordings of one run."""

    def test_columns_of_one_run_are_of_one_recording(self) -> None:
        first = {"Time": TIME, "q2_d": COURSE, "q2": LATE}
        second = {"Time": TIME, "q2_d": COURSE, "q2": LATE**2, "s2": LATE, "tau2": LATE}
        _, mapping = suggested(source("c1_trial1.csv", first), source("c1_trial2.csv", second))
        files = {name: {entry.file for entry in run.signals} for name, run in mapping.runs.items()}
        assert files == {"controller_1": {"c1_trial2.csv"}, "controller_1_repeat_2": {"c1_trial1.csv"}}

    def test_files_that_complete_each_other_are_one_recording(self) -> None:
        parts = [
            source(f"c1_{part}{trial}.csv", {"Time": TIME, f"{part}2": LATE**trial})
            for part in ("q", "tau")
            for trial in (1, 2)
        ]
        _, mapping = suggested(*parts)
        files = [[entry.file for entry in run.signals] for run in mapping.runs.values()]
        assert files == [["c1_q1.csv", "c1_tau1.csv"], ["c1_q2.csv", "c1_tau2.csv"]]

    def test_a_repeated_run_with_a_load_keeps_it(self) -> None:
        trials = [source(f"c1_0.3kg_{k}.csv", {"Time": TIME, "q2": LATE**k}) for k in (1, 2)]
        _, mapping = suggested(*trials)
        assert list(mapping.runs) == ["controller_1_payload", "controller_1_payload_repeat_2"]
        assert {run.payload_mass_kg for run in mapping.runs.values()} == {0.3}

    def test_one_line_for_all_that_is_repeated(self) -> None:
        signals = ("q2_d", "q2", "q3_d", "q3", "tau2", "tau3")
        trials = [
            source(f"c1_trial{k}.csv", {"Time": TIME} | dict.fromkeys(signals, COURSE**k)) for k in (1, 2, 3)
        ]
        suggestion, _ = suggested(*trials)
        assert len([remark for remark in suggestion.remarks if "c1_trial1.csv" in remark]) == 1


def test_without_a_run_there_is_one_to_fill_in() -> None:
    found = Found("SYNTHETIC")
    found.add("mystery", np.random.default_rng(3).normal(size=100))
    columns = understand([Source("x.csv", "SYNTHETIC", 0, "0" * 32, tuple(found.signals))], S_INV)
    suggestion = suggest(columns, "SYNTHETIC")
    assert not suggestion.runs
    head, _, below = suggestion.text.partition("runs:\n")
    run = [line.removeprefix("#") for line in below.split("\n\n")[0].split("\n")[1:]]
    mapping = Mapping.model_validate(load("\n".join([head, "runs:", *run]), "mapping.yaml").tree)
    assert [entry.signal for entry in mapping.runs["controller_1"].signals] == ["mystery"]


NAMES = ("t", "Time (s)", "q2", "q2_d", "q3", "e2", "X1", "Y1", "s2", "tau2", "motor1", "joint", "controller")
RECORDS = ("SYNTHETIC.csv", "SYNTHETIC_controller1.mat", "SYNTHETIC_Fig14a.csv", "SYNTHETIC_decouple.txt")


def odd_column(rng: np.random.Generator, count: int) -> Array:
    """Numbers as a file may hold them, sensible or not."""
    t, wave = np.arange(float(count)), 30.0 * np.sin(np.arange(count) / 50.0)
    kinds = (
        t * rng.choice([0.0, 0.002, 1.0, 1e-6]),
        t * 1e3 + rng.choice([1.7e9, 1.7e15, -5.0]),
        np.full(count, rng.choice([np.nan, np.inf, -1e308, 1e-320, 0.0])),
        rng.standard_normal(count) * 10.0 ** rng.integers(-300, 300),
        rng.integers(0, 4, count).astype(float),
        np.tile(t, 3)[:count] % max(count // 3, 1),
        np.where(t < rng.integers(0, count), wave, rng.choice([np.nan, np.inf])),
        0.02197265625 * np.round(wave / 0.02197265625),
        wave + 0.1 * rng.standard_normal(count),
        -wave,
    )
    return np.asarray(kinds[rng.integers(0, len(kinds))])


@pytest.mark.parametrize("seed", range(40))
def test_whatever_columns_hold_is_suggested_and_read_back(seed: int, tmp_path: Path) -> None:
    """Warnings are errors: none of it may reach a terminal."""
    rng = np.random.default_rng(seed)
    for _ in range(8):
        sources = []
        for name in rng.choice(RECORDS, rng.integers(1, 4), replace=False).tolist():
            found, count = Found(name), int(rng.choice([1, 2, 8, 60, 600]))
            for column in rng.choice(NAMES, rng.integers(1, 9)).tolist():
                found.add(column, odd_column(rng, count), group="g")
            sources.append(Source(name, "SYNTHETIC", 0, "0" * 32, tuple(found.signals)))
        suggestion = suggest(understand(sources, S_INV), "SYNTHETIC")
        path = tmp_path / "SYNTHETIC.yaml"
        path.write_text(suggestion.text, encoding="utf-8")
        try:
            mapping = load_mapping(path).mapping
            assembly = Assembly(sources, mapping, "m.yaml", S, lambda time, _: ("ok", float(time[-1])))
            doubts = [doubt for run in assembly.runs().values() for doubt in doubts_about(run)]
        except TendonreproError:
            # One clear message, where nothing could be made of it.
            continue
        assert all(isinstance(doubt, str) for doubt in doubts)
