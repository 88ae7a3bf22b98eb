"""Suggested mappings: they load whatever the names are, and times stay those of the record."""

from __future__ import annotations

from collections.abc import Mapping as AnyMapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tendonrepro.arithmetic import coupling_of, table_1
from tendonrepro.dataset.assembly import Assembly
from tendonrepro.dataset.mapping import Mapping
from tendonrepro.dataset.meaning import understand
from tendonrepro.dataset.signals import Found, Source
from tendonrepro.dataset.suggestion import Suggestion, suggest
from tendonrepro.errors import ConfigError
from tendonrepro.published import published
from tendonrepro.strict_yaml import load

Array = NDArray[np.float64]
S, S_INV = coupling_of(table_1(published()))
TIME = 0.01 * np.arange(500.0)
COURSE = np.sin(TIME)
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
        assert not suggestion.remarks
