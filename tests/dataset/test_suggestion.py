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
from tendonrepro.errors import TendonreproError

Array = NDArray[np.float64]
S, S_INV = coupling_of(table_1(published()))
TIME = 0.01 * np.arange(500.0)
COURSE = np.sin(TIME)
LATE = COURSE - 1e-3 * np.cos(7.0 * TIME)

# Names as YAML could hold them: it has no way to write half of a pair, and the strict reader refuses NUL.
names = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=30)


def source(name: str, signals: AnyMapping[str, Array], unit: str | None = "rad", **times: Array) -> Source:
    found = Found("SYNTHETIC")
    for path, values in signals.items():
        found.add(path, values, label=path.rpartition("/")[2], unit=unit, group="log", time=times.get(path))
    return stored(name, found)


def stored(name: str, found: Found) -> Source:
    return Source(name, "SYNTHETIC", 0, "0" * 32, tuple(found.signals))


def suggested(*sources: Source, title: str = "SYNTHETIC") -> tuple[Suggestion, Mapping]:
    suggestion = suggest(understand(sources), title)
    return suggestion, Mapping.model_validate(load(suggestion.text, "mapping.yaml").tree)


@given(file=names, signal=names, title=names)
def test_any_name_can_be_suggested(file: str, signal: str, title: str) -> None:
    found = Found("SYNTHETIC")
    found.add(signal, COURSE, label="q2", unit="rad")
    _, mapping = suggested(stored(file, found), title=title)
    (run,) = mapping.runs.values()
    assert [(entry.file, entry.signal) for entry in run.signals] == [(file, signal)]
    assert mapping.title == title


@given(file=names, first=names, second=names)
def test_any_name_can_stand_in_a_comment(file: str, first: str, second: str) -> None:
    """In what is to be decided, and among the columns in no run."""
    found = Found("SYNTHETIC")
    for path, label, values in ((first, "q2", COURSE), (second, "q2", LATE), ("zz", second, LATE)):
        found.add(path, values, label=label, unit="rad")
    suggestion, mapping = suggested(stored(file, found))
    assert all(entry.file == file for run in mapping.runs.values() for entry in run.signals)
    head, _, body = suggestion.text.partition("\n\n")
    assert all(line.startswith("#") for line in head.split("\n"))
    assert body.count("\n    - variable: ") == sum(suggestion.runs.values())


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


DEGREES = 10.0 * np.stack([COURSE, np.sin(0.7 * TIME), np.sin(1.3 * TIME)])
STEPS = DEGREES - 0.3 * np.cos(TIME)
ANGLES = {f"q{k + 1}": STEPS[k] for k in range(3)}
WINCHES = S_INV @ STEPS
LONG = {
    "Time": np.tile(TIME, 4),
    "controller": np.repeat([1.0, 1.0, 3.0, 3.0], len(TIME)),
    "joint": np.repeat([2.0, 3.0, 2.0, 3.0], len(TIME)),
    "measured": np.tile(LATE, 4),
}
BELOW = {"Time": 0.01 * np.arange(2 * len(TIME)), "q2_d": np.tile(COURSE, 2), "q2": np.tile(LATE, 2)}
WORDED = Found("SYNTHETIC")
for path, values in (BELOW | {"law": np.repeat([1, 2], len(TIME))}).items():
    note = "words as numbers: 1 is 'Controller 1', 2 is 'Controller 3'" if path == "law" else ""
    WORDED.add(path, values, label=path, group="log", note=note)
TAKEN = "controller_1: several columns claim the same place, the first are taken, not"
ALONE = "is not guessed; their lines stand at the end, take them under `signals` of a run"
# What is no longer told from numbers: files, and what is asked with the key of the mapping that settles it.
ASKED: dict[str, tuple[list[Source], str]] = {
    "a table in long form": (
        [source("tidy.csv", LONG, None)],
        "'controller', 'joint' may tell rows of several runs apart; `where` on it takes those of one",
    ),
    "a table in long form, by time": (
        [source("tidy.csv", {name: column[np.argsort(LONG["Time"])] for name, column in LONG.items()}, None)],
        "'controller', 'joint' may tell rows of several runs apart",
    ),
    "runs below each other, with a time that goes on": (
        [source("c1.csv", BELOW | {"controller": np.repeat([1.0, 3.0], len(TIME))}, None)],
        "'controller' may tell rows of several runs apart",
    ),
    "runs below each other, told apart by words": (
        [stored("c1.csv", WORDED)],
        "(words as numbers: 1 is 'Controller 1', 2 is 'Controller 3') may tell rows of several runs apart",
    ),
    "runs below each other, nothing tells them apart": (
        [source("c1.csv", BELOW | {"Time": np.tile(TIME, 2)}, None)],
        f"times go back after sample {len(TIME)}: are several runs below each other?",
    ),
    "numbers of runs far apart": (
        [source("c1.csv", BELOW | {"run_id": np.repeat([10.0, 20.0], len(TIME))}, None)],
        "'run_id' may tell rows of several runs apart",
    ),
    "an error without a unit beside angles with one": (
        [source("c1.csv", {"Time": TIME, "q2_d (deg)": COURSE, "e2": LATE}, None)],
        "angles or errors without a known unit are taken to be in deg: `unit`",
    ),
    "repetitions": (
        [source(f"c1_{k}.csv", {"Time": TIME, "q2_d": COURSE, "q2": LATE**k, "tau2": LATE}) for k in (1, 2)],
        f"{TAKEN} c1_2.csv: q2_d, c1_2.csv: q2, c1_2.csv: tau2; a desired angle is `variable: q_d`; another",
    ),
    "two columns for one place": (
        [source("c1.csv", {"Time": TIME, "q2": LATE, "angle 2": LATE**2})],
        f"{TAKEN} c1.csv: angle 2;",
    ),
    "an angle below the title calculated": (
        [source("c1.mat", {"log/encoder/Joint 2": STEPS[1], "log/calculated/Joint 2": DEGREES[1]}, "deg")],
        f"{TAKEN} c1.mat: log/calculated/Joint 2;",
    ),
    "encoder and calculated angle of one name": (
        [source("c1.csv", {"Time": TIME, "Q2": STEPS[1], "q2": DEGREES[1]}, "deg")],
        f"{TAKEN} c1.csv: q2;",
    ),
    "the unit of s": (
        [source("c1.csv", {"Time": TIME, "q2": STEPS[1], "s2": LATE}, None)],
        "controller_1: no unit of a surface is given, deg/s is taken: `unit`",
    ),
    "an error beside one angle": (
        [source("c1.csv", {"Time": TIME, "q2": STEPS[1], "e2": STEPS[1] - DEGREES[1]}, "deg")],
        "controller_1: an error is taken for desired less measured; if it is the other way, `sign: -1`",
    ),
    "constants": (
        [source("c1.mat", {"time": TIME, "e": np.tile([1.2, 0.4, 0.7], (len(TIME), 1))}, None)],
        f"c1.mat: what some columns are {ALONE}",
    ),
    "points of space in a file of errors": (
        [source("tracking error.csv", {"time": TIME, "ax": COURSE, "ay": LATE, "az": LATE**2}, None)],
        f"tracking error.csv: what some columns are {ALONE}",
    ),
    "axes of a sensor": (
        [source("c1.csv", {"time": TIME, "pos_x": STEPS[0], "pos_y": STEPS[1]}, None)],
        f"c1.csv: what some columns are {ALONE}",
    ),
    "columns that follow each other": (
        [source("x.csv", {"Time": TIME, "xx": DEGREES[1], "yy": STEPS[1]}, None)],
        f"x.csv: what some columns are {ALONE}",
    ),
    "motors without a name": (
        [source("x.csv", {"Time": TIME, "xx": WINCHES[1]} | ANGLES, "deg")],
        f"x.csv: what some columns are {ALONE}",
    ),
    "gear, sign and start of motors": (
        [source("x.csv", {"Time": TIME, "motor2": 3.0 - 100.0 * WINCHES[1]} | ANGLES, "deg")],
        "decouple: motor angles are taken for those of the winch; before the reducer `scale: 0.01`",
    ),
    "joints that are counted in two ways": (
        [
            source("c2.csv", {"Time": TIME, "q1": LATE, "q2": COURSE}),
            source("decoupling.csv", {"Time": TIME} | ANGLES, "deg"),
        ],
        "controller_2: only joints 1 and 2 appear, but not everywhere: are they the paper's 2 and 3? `joint`",
    ),
    "curves of a figure in the order of its legend": (
        [source("fig14b.csv", {"X": TIME, "Y1": COURSE, "Y2": LATE, "Y3": LATE**2}, None)],
        f"fig14b.csv: what some columns are {ALONE}",
    ),
    "encoder steps of one of two curves": (
        [source("Fig11.csv", {"X": TIME, "one": DEGREES[1], "two": np.round(DEGREES[1] / 0.022)}, None)],
        f"Fig11.csv: what some columns are {ALONE}",
    ),
    "a vector beside a timeseries": (
        [source("c1.mat", {"log/q2_d": COURSE, "log/q2": LATE}, **{"log/q2_d": TIME})],
        "controller_1: columns without a time: every 0.001 s is the paper's, `step_s` is the record's",
    ),
    "times beside each curve": (
        [source("c1.csv", {"X1": TIME, "q2_d": COURSE, "X2": 1.1 * TIME, "q2": LATE}, None)],
        "controller_1: several columns can be times, each is taken for those that end with it, on its right",
    ),
    "a block that ends before its times": (
        [source("c1.csv", {"Time": TIME, "q2": np.r_[LATE[:-50], np.full(50, np.nan)]}, None)],
        "controller_1: ends on another row than its times; `time` beside its entry names",
    ),
    "a factor before the unit": (
        [source("c1.csv", {"Time": TIME, "e2 (10^-3 deg)": LATE}, None)],
        "controller_1: words that say nothing known: 10, 3 in 'e2 (10^-3 deg)'; does one change",
    ),
    "what was done to an error": (
        [source("c1.csv", {"Time": TIME, "Squared error joint 2 (deg)": LATE}, None)],
        "squared in 'Squared error joint 2",
    ),
    "a channel behind the joint": (
        [source("c1.csv", {"Time": TIME, "q3 act (AI2)": COURSE, "q2 act (AI3)": LATE}, "deg")],
        "ai, 3 in 'q2 act (AI3)', ai, 2 in 'q3 act (AI2)'",
    ),
    "a denied controller": (
        [source("NTSM without alpha-TDE.csv", {"Time": TIME, "e2": LATE}, "deg")],
        "controller_2: words that say nothing known: without in 'NTSM without alpha-TDE'",
    ),
    "a simulation": (
        [source("simulation/c3.csv", {"Time": TIME, "e2": LATE}, "deg")],
        "controller_3: words that say nothing known: simulation in 'simulation'",
    ),
    "a time as the unit of an error": (
        [source("c1.csv", {"Time": TIME, "e2": LATE}, "min")],
        "controller_1: angles or errors without a known unit are taken to be in deg: `unit`",
    ),
    "an angle as the unit of a rate": (
        [source("c1.csv", {"Time": TIME, "dq2": LATE}, "deg")],
        "controller_1: no unit of a rate is given, rad/s is taken: `unit`",
    ),
    "a torque in volts": (
        [source("c1.csv", {"Time": TIME, "u2": LATE}, "V")],
        "controller_1: 'u2': 'V' is no known unit of a torque: `scale`, `variable`",
    ),
    "a torque without a unit": (
        [source("c1.csv", {"Time": TIME, "tau2": LATE}, None)],
        "controller_1: no unit of a torque is given, N m is taken: `unit`",
    ),
    "torques of motors": (
        [source("c1.csv", {"Time": TIME, "motor torque 2": LATE}, "N m")],
        "controller_1: torques of motors are taken for those of joints; leave them out if they are",
    ),
    "the rate of an error": (
        [source("c1.csv", {"Time": TIME, "e_dot2": LATE}, "rad/s")],
        "controller_1: words that say nothing known: e in 'e_dot2'",
    ),
    "joints by their place": (
        [source("c1.csv", {"Time": TIME, "elbow error": LATE, "shoulder error": COURSE}, "deg")],
        "controller_1: no name says which joint, so columns are numbered from left to right: `joint`",
    ),
    "joints by name for some": (
        [source("c1.csv", {"Time": TIME, "Actual": COURSE, "Actual 1": LATE}, "deg")],
        "c1.csv: of columns alike some have a joint in their names, some none: `joint`",
    ),
    "an experiment by its joints": (
        [source("tracking.csv", {"Time": TIME, "q1": STEPS[1], "q2": COURSE, "q3": LATE}, "deg")],
        "decouple: taken for the decoupling experiment for what is in it, no name says so",
    ),
    "a joint in a file of another": (
        [source("TDE-TSM_joint2.csv", {"Time": TIME, "error 2": LATE, "error 3": COURSE}, "deg")],
        "controller_3: names within each other say different joints: `joint`",
    ),
    "sums at the foot": (
        [source("c1.csv", {"sample": np.r_[np.arange(500.0), np.nan], "e2": np.r_[LATE, LATE.sum()]}, "deg")],
        "controller_1: rows without a number under 'sample' are taken for samples; where they are sums",
    ),
    "nothing that was understood": (
        [source("c1.csv", {"Time": TIME, "current error 2": LATE}, "A")],
        "no run: no column was taken for a variable of a run: write runs, or give columns and files plainer",
    ),
    "a torque that is called a time": (
        [source("c1.csv", {"Time": TIME, "time delay estimate 2": LATE, "q2": COURSE}, "N m")],
        "controller_1: angles or errors without a known unit are taken to be in rad",
    ),
    "slow samples since 1970": (
        [source("c1.csv", {"Time": 1.7e9 + 5.0 * np.arange(500.0), "q2": LATE}, None)],
        "no unit of the times is stated, ms is taken, which makes their step 5 ms",
    ),
}


@pytest.mark.parametrize("order", ["Time q2_d q2 Time_2 q3_d q3", "q2_d q2 Time q3_d q3 Time_2"])
def test_tables_side_by_side_keep_their_times(order: str) -> None:
    """A second, slower table beside the first would be too fast by the times of that."""
    half = np.where(np.arange(TIME.size) < TIME.size // 2, 1.0, np.nan)
    held = {"Time": TIME, "q2_d": COURSE, "q2": LATE, "Time_2": 2.0 * half * TIME}
    held |= {"q3_d": half * COURSE, "q3": half * LATE}
    sheet = {name: held[name] for name in order.split()}
    columns = understand([source("c1.csv", sheet, None)])
    told = {column.label: column.time.signal for column in columns if column.time}
    assert told == dict.fromkeys(("q2_d", "q2"), "Time") | dict.fromkeys(("q3_d", "q3"), "Time_2")


@pytest.mark.parametrize("case", ASKED)
def test_what_is_not_guessed_is_asked(case: str) -> None:
    """At the head of the mapping, which loads as it is or with the lines at its end."""
    sources, question = ASKED[case]
    suggestion = suggest(understand(sources), "SYNTHETIC")
    assert any(question in remark for remark in suggestion.remarks), suggestion.remarks
    assert question in " ".join(line for line in suggestion.text.split("\n") if line.startswith("# DECIDE: "))
    assert suggestion.text.count("\n    - variable: ") == sum(suggestion.runs.values())
    assert suggestion.text.count("\n#    - variable: ") == len(suggestion.left)
    if suggestion.runs:
        tree = load(suggestion.text, "mapping.yaml").tree
        assert Mapping.model_validate(tree).runs.keys() == suggestion.runs.keys()


def test_what_is_settled_is_not_asked() -> None:
    """Columns with names, units and a common time leave nothing to decide; a curve may stand in two files."""
    signals = {"Time": TIME, "q2_d": COURSE, "q2": LATE, "e2": COURSE - LATE}
    suggestion, mapping = suggested(*(source(f"{folder}/c1.csv", signals) for folder in "ab"))
    assert suggestion.runs == {"controller_1": 3}
    assert not [remark for remark in suggestion.remarks if "unit of the times" not in remark]
    assert {entry.file for entry in mapping.runs["controller_1"].signals} == {"a/c1.csv"}


def test_files_that_complete_each_other_are_one_recording() -> None:
    """A run never mixes recordings: a table that contradicts the first is left out as a whole."""
    parts = [
        source(f"c1_0.3kg_{part}{trial}.csv", {"Time": TIME, f"{part}2": LATE**trial})
        for part in ("q", "tau")
        for trial in (1, 2)
    ]
    _, mapping = suggested(*parts)
    (run,) = mapping.runs.values()
    assert [entry.file for entry in run.signals] == ["c1_0.3kg_q1.csv", "c1_0.3kg_tau1.csv"]
    assert run.payload_mass_kg == 0.3


NAMES = ["t", "Time (s)", "q2", "q2_d", "q3", "e2", "X1", "Y1", "s2", "tau2", "motor1", "joint", "controller"]
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
            sources.append(stored(name, found))
        suggestion = suggest(understand(sources), "SYNTHETIC")
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
