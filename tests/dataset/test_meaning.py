"""What is guessed from names and numbers, and the mapping that is suggested from it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tendonrepro.dataset.mapping.suggestion import suggest
from tendonrepro.dataset.meaning import columns as columns_module
from tendonrepro.dataset.meaning.columns import Column, columns_of, sampling_step
from tendonrepro.dataset.meaning.understand import is_label, understand
from tendonrepro.dataset.meaning.words import Hints, hints, printable
from tendonrepro.dataset.readers.signals import Found, Source
from tendonrepro.dataset.readers.units import FACTORS, factor, plain_unit

Array = NDArray[np.float64]

TIME = 0.001 * np.arange(4000.0)
COUNT = 360.0 / 16384.0


def course(joint: int) -> Array:
    """A smooth motion in degrees, another one for each joint."""
    return (20.0 + 4.0 * joint) * 0.5 * (1.0 - np.cos(2.0 * np.pi * TIME / (1.5 + 0.5 * joint)))


def followed(joint: int, size: float = 0.3) -> Array:
    """What an encoder in degrees reads of it."""
    late = course(joint) - size * np.sin(2.0 * np.pi * TIME / 1.1 + joint)
    return COUNT * np.round(late / COUNT)


def stored(name: str, found: Found) -> Source:
    return Source(name, "SYNTHETIC", 0, "0" * 32, tuple(found.signals), tuple(found.skipped), found.texts)


def source(name: str, signals: Mapping[str, Array], group: str = "g", **unit: str) -> Source:
    found = Found("SYNTHETIC")
    for path, values in signals.items():
        found.add(path, values, group=group, unit=unit.get(path))
    return stored(name, found)


def guessed(*sources: Source) -> dict[str, Column]:
    return {
        f"{column.signal.path}{f'[{column.number}]' if column.signal.columns > 1 else ''}": column
        for column in understand(sources)
    }


# What a name says: quantity, joint.
COLUMNS: dict[str, tuple[str | None, int | None]] = {
    "q2_des": ("desired", 2), "qd3": ("desired", 3), "theta2_d": ("desired", 2),
    "DesiredAngle2": ("desired", 2), "期望角度2": ("desired", 2), "关节3 实际": ("measured", 3),
    "J3_actual": ("measured", 3), "Joint 2 (deg)": ("measured", 2), "e2": ("error", 2),
    "tracking error joint 3": ("error", 3), "θ2误差": ("error", 2), "e_2 (deg)": ("error", 2),
    "tau_m2": ("torque", 2), "图15e 关节2力矩": ("torque", 2), "Ĥ3": ("estimate", 3),
    "sliding surface 2": ("surface", 2), "sigma2": ("surface", 2), "Motor 3 angle": ("motor", 3),
    "theta_m2": ("motor", 2), "q_m3": ("motor", 3), "电机转角θm1": ("motor", 1),
    "q_calc2": ("calculated", 2), "计算关节角 θ1": ("calculated", 1), "dq2": ("rate", 2),
    "q2_dot": ("rate", 2), "dqd2": ("rate", 2), "de2": ("other", 2), "time (s)": ("time", None),
    "时间/s": ("time", None), "t": ("time", None), "Sample": ("index", None), "column 3": (None, None),
    "data2": (None, None), "fig15e": (None, None),
}  # fmt: skip
# Controller, payload in kg; not a number where there is one but not how heavy.
LOADED = float("nan")
RUN_NAMES: dict[str, tuple[int | None, float | None]] = {
    "Controller 1": (1, None), "ctrl3": (3, None), "α-TDE-NTSM": (1, None), "a-TDE-NTSM": (1, None),
    "run_aTDE_NTSM": (1, None), "TDE-NTSM_noload": (2, 0.0), "TDE-TSM": (3, None), "控制器2": (2, None),
    "c1_200g": (1, 0.2), "ctrl1_0p2kg": (1, 0.2), "Controller1 0.2kg": (1, 0.2),
    "proposed_payload": (1, LOADED), "with payload": (None, LOADED), "有载荷": (None, LOADED),
    "α–TDE–NTSM": (1, None), "TDE-NTSM with alpha": (1, None), "TDE-NTSM without alpha": (2, None),
    "C1 wo load": (1, 0.0), "C1 w/o load": (1, 0.0), "C1 zero load": (1, 0.0), "C1 w load": (1, LOADED),
    "load-side encoder 2": (None, None), "NTSM (no load)": (2, 0.0), "proposed without payload": (1, 0.0),
    "controller1_TDE-TSM": (3, None), "C1 payload 0": (1, 0.0), "C1_load0": (1, 0.0),
    "Payload (kg): 0": (None, 0.0), "C1 0,2kg": (1, 0.2), "load torque 2": (None, None),
    "Kinematic Decoupling and alpha-TDE-NTSM Control": (None, None),
    "without load": (None, 0.0), "无载荷": (None, 0.0), "withoutload": (None, 0.0),
    "fig14": (None, None), "图14a": (None, None), "Sheet1!G4:K2304": (None, None),
}  # fmt: skip


@pytest.mark.parametrize("name", COLUMNS)
def test_names_of_columns(name: str) -> None:
    said = hints(name)
    assert (said.quantity, said.joint) == COLUMNS[name]


@pytest.mark.parametrize("name", RUN_NAMES)
def test_names_of_runs(name: str) -> None:
    controller, payload = RUN_NAMES[name]
    said = hints(name)
    assert said.controller == controller
    assert said.payload_mass == pytest.approx(payload, nan_ok=True)


UNREAD = {
    "q2_d (deg)": "", "time (s)": "", "Joint 2 desired angle (deg)": "", "关节2误差": "", "实验数据": "",
    "C1_no_load": "", "controller 1, 0.2kg": "", "TDE-NTSM": "", "error2_deg": "", "2026-05-01_run_12": "",
    "q2_take3": "take 3", "Integral error 2": "integral", "e2 (x10 deg)": "10", "C1_0.2": "0.2",
    "3rd joint": "3 rd", "q2_law1": "law 1", "joint 2 (motor 3)": "2 3", "TSM (no NTSM)": "no",
    "controller1_TDE-TSM": "controller 3 or controller 1", "proposed_c2": "controller 1 or controller 2",
    "decoupling of alpha-TDE": "decoupling or a controller", "payload 0-2 kg": "0", "C1_0_2kg": "0",
    "load 1": "1", "C1_0.2kg": "", "C1 payload 0": "", "ctrl1_0p2kg": "", "C1_sim": "sim",
    "q2_c": "c",
    "Filtered q2": "filtered", "q2_s": "s", "q2_d": "", "q2_m": "", "a": "", "e2 (π rad)": "π", "∫e2": "∫",
    "关节2误差平方": "误差平方", "关节2仿真角度": "仿真角度", "无α的NTSM": "无", "关节2期望角度(°)": "",
    "控制器1空载": "", "q2 модель": "модель", "error 2 적분": "적분", "velocity error 2": "error of what",
    "e_dot2": "e", "e_joint2": "e", "error e2": "", "fig15e joint 2 torque": "", "q̃2": "\u0303",
    "q̇2": "\u0307",
    "qd2-q2 (deg)": "desired or measured", "Joint 2 desired - actual": "desired or measured",
    "dq2_hat": "estimate of what", "q2_hat": "estimate of what", "H_hat2": "",
    "torque estimate 2": "estimate of what", "s_dot2": "s", "vel2 rad/s": "",
    "desired torque 2": "torque of what", "load torque 2 (Nm)": "load torque of what",
    "C1_load_q2": "load", "load-side angle 2": "", "q2 (º)": "",
    "Estimated joint angle 2": "estimate of what", "Tabelle1": "", "torque 2 (Nm)": "",
}  # fmt: skip


@pytest.mark.parametrize("name", UNREAD)
def test_words_that_say_nothing_known_are_told(name: str) -> None:
    assert " ".join(hints(name).unread) == UNREAD[name]


@given(st.text(max_size=40))
def test_any_name_can_be_read(name: str) -> None:
    said = hints(name)
    assert said.joint in {None, 0, 1, 2, 3}


def test_units_as_people_write_them() -> None:
    written = {"°": "deg", "Degrees": "deg", "(rad)": "rad", "N·m": "N m", "Nm": "N m", "sec": "s"}
    assert {text: plain_unit(text) for text in written} == written
    assert plain_unit("furlong") is None
    assert all(plain_unit(unit) == unit for units in FACTORS.values() for unit in units)


SAME = {
    "angle": {"rev": 1.0, "deg": 360.0, "arcmin": 21600.0, "rad": 2.0 * np.pi, "mrad": 2000.0 * np.pi},
    "rate": {"rpm": 60.0, "deg/s": 360.0, "rad/s": 2.0 * np.pi},
    "acceleration": {"deg/s^2": 180.0, "rad/s^2": np.pi},
    "torque": {"N m": 9.80665, "mN m": 9806.65, "N cm": 980.665, "N mm": 9806.65, "kgf cm": 100.0},
    "time": {"min": 1.0, "s": 60.0, "ms": 6e4, "us": 6e7, "ns": 6e10},
}
"""One amount of each kind in all its units."""


@pytest.mark.parametrize("kind", FACTORS)
def test_an_amount_is_the_same_in_every_unit(kind: str) -> None:
    assert SAME[kind].keys() == FACTORS[kind].keys()
    (unit,) = {"rad", "rad/s", "rad/s^2", "N m", "s"} & SAME[kind].keys()
    amounts = [number * factor(name, kind) for name, number in SAME[kind].items()]
    assert amounts == pytest.approx([SAME[kind][unit]] * len(amounts), rel=1e-14)


def test_steps_of_a_time_axis() -> None:
    kept = np.arange(len(TIME)) % 500 != 7
    for even in (TIME, TIME[kept], np.append(TIME, [np.nan, np.nan])):
        assert sampling_step(even) == pytest.approx(0.001)
    for odd in (TIME[::-1], course(2), TIME**2, np.where(kept, TIME, np.nan)):
        assert sampling_step(odd) is None


@pytest.mark.parametrize("lag", [1.0, np.nan, np.inf])
def test_numbers_alone_tell_time_and_nothing_else(lag: float) -> None:
    table = np.stack([TIME, course(2), course(2) - lag * (course(2) - followed(2))], axis=1)
    found = guessed(source("c2.npy", {"array": table}))
    assert [found[f"array[{number}]"].quantity for number in (1, 2, 3)] == ["time", None, None]


def test_a_named_table_is_understood() -> None:
    signals = {"t": TIME, "qd2": course(2), "q2": followed(2), "qd3": course(3), "q3": followed(3)}
    found = guessed(source("controller1.csv", signals))
    told = [(column.quantity, column.joint) for column in found.values()]
    assert told == [("time", None), ("desired", 2), ("measured", 2), ("desired", 3), ("measured", 3)]
    assert [column.unit for column in found.values()] == ["s", "deg", "deg", "deg", "deg"]
    assert found["q2"].time == found["t"].address


def test_numbers_that_readers_give_to_columns_of_one_name_are_no_joints() -> None:
    found = Found("SYNTHETIC")
    for _ in range(3):
        found.add("Position", np.arange(20.0) ** 2, label="Position")
    columns = understand([Source("c1.csv", "SYNTHETIC", 0, "0" * 32, tuple(found.signals))])
    assert [column.signal.path for column in columns] == ["Position", "Position (2)", "Position (3)"]
    assert all("by its place" in column.because[-1] or "rad" in column.because[-1] for column in columns)
    assert [column.own.joint for column in columns] == [None] * 3
    assert {hint.joint for column in columns for hint in column.around} == {None}


def test_a_stored_unit_wins() -> None:
    found = guessed(source("x.csv", {"t": TIME, "q2": course(2)}, q2="rad"))
    assert found["q2"].unit == "rad"


def test_columns_without_numbers_are_joints_in_order() -> None:
    both = np.stack([course(2), course(3)], axis=1)
    found = guessed(source("controller3.mat", {"t": TIME, "q_des": both, "q": 0.99 * both}))
    assert [found[f"{name}[{k}]"].joint for name in ("q_des", "q") for k in (1, 2)] == [2, 3, 2, 3]


@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_gaps_stop_nobody(hole: float) -> None:
    """Whatever has them: the guess goes on, and what can be known is known."""
    q = np.deg2rad(np.stack([followed(1), followed(2), followed(3)], axis=1))
    named = {"t": TIME} | {f"joint{k + 1}": q[:, k] for k in range(3)}
    named |= {f"motor{k + 1}": 100.0 * q[:, k] + 20.0 for k in range(3)}
    named |= {"e2": np.deg2rad(course(2)) - q[:, 1], "qd2": np.deg2rad(course(2)), "s2": 0.1 * q[:, 1]}
    for name in named:
        for rows in (slice(0, 3), slice(2000, 2500), slice(-3, None), slice(None)):
            signals = {other: values.copy() for other, values in named.items()}
            signals[name][rows] = hole
            told = {c.label: c.quantity for c in understand([source("decoupling.csv", signals)])}
            assert [told[f"motor{k}"] for k in (1, 2, 3)] == ["motor"] * 3


def test_one_sheet_with_all_controllers_shares_what_belongs_to_none() -> None:
    signals = {"t": TIME, "qd2": course(2)} | {f"q2 C{n}": followed(2, 0.1 * n) for n in (1, 2, 3)}
    runs = suggest(understand([source("fig14.xlsx", signals)]), "SYNTHETIC").runs
    assert runs == {"controller_1": 2, "controller_2": 2, "controller_3": 2}


def test_the_decoupling_experiment_is_told_from_the_comparison() -> None:
    angles = {f"{name}{k}": course(k) for name in ("motor", "joint") for k in (1, 2, 3)}
    columns = understand([source("experiment.csv", {"t": TIME} | angles)])
    assert suggest(columns, "SYNTHETIC").runs == {"decouple": 6}


def test_a_time_apart_serves_columns_of_its_length() -> None:
    found = Found("SYNTHETIC")
    found.add("tout", TIME)
    found.add("scope/q2", followed(2), group="scope")
    columns = understand([stored("c1.mat", found)])
    assert columns[1].time == columns[0].address
    assert not any("times" in doubt for doubt in columns[1].doubts)


def test_times_of_another_table_are_taken_and_asked_about() -> None:
    found = Found("SYNTHETIC")
    found.add("first/t", TIME, group="first")
    found.add("first/q3", followed(3), group="first")
    found.add("second/q2", followed(2), group="second")
    columns = understand([stored("c1.mat", found)])
    assert [column.time for column in columns[1:]] == [columns[0].address] * 2
    assert not any("times" in doubt for doubt in columns[1].doubts)
    assert any("those of 'first' are as long" in doubt for doubt in columns[2].doubts)


def test_the_same_joint_under_several_controllers_is_no_motor() -> None:
    names = {"t": TIME} | {f"控制器{n}(°)": followed(3, 0.1 * n) for n in (1, 2, 3)}
    found = guessed(source("关节3.csv", names))
    kinds = {(column.quantity, column.joint) for path, column in found.items() if path != "t"}
    assert kinds == {("measured", 3)}


def test_a_sample_index_is_no_time() -> None:
    signals = {"Sample": np.arange(4000.0), "e2": 0.3 * np.cos(TIME)}
    suggestion = suggest(understand([source("c1.csv", signals)]), "SYNTHETIC")
    assert "step_s: 0.001" in suggestion.text
    assert any("without a time" in remark for remark in suggestion.remarks)
    seconds = guessed(source("c1.csv", {"when": np.arange(4000.0), "e2": 0.3 * np.cos(TIME)}, when="s"))
    assert seconds["when"].quantity == "time"


def test_titles_name_what_stands_below_them() -> None:
    found = Found("SYNTHETIC")
    for table, title in (("A3:B9", "Controller 2"), ("D3:E9", "Controller 1, 0.2 kg payload")):
        found.add(f"{table}/t", TIME, group=table)
        found.add(f"{table}/q2", followed(2), group=table)
        found.text(f"{table}/title", title)
    runs = suggest(understand([stored("x.xlsx", found)]), "x").runs
    assert runs == {"controller_1_payload": 1, "controller_2": 1}


@pytest.fixture(name="said")
def _said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every text that is read; what it says is its place in this list."""
    said: list[str] = []

    def noted(name: str) -> Hints:
        said.append(name)
        return Hints(joint=len(said) - 1)

    monkeypatch.setattr(columns_module, "hints", noted)
    return said


def test_texts_speak_nearest_first(said: list[str]) -> None:
    found = Found("SYNTHETIC")
    found.add("a/b/q", TIME, label="x")
    places = {"a/title": "of a", "a/b/q/note": "of q", "other/b/title": "of others", "title": "of all"}
    for path, text in (places | {"a/b/title": "of b", "a/b/second": "more of b"}).items():
        found.text(path, text)
    near = ["q", "of q", "of b", "more of b", "of a", "b", "a", "file", "folder", "of all"]
    (column,) = columns_of([stored("folder/file.mat", found)])
    assert [said[hint.joint] for hint in column.around if hint.joint is not None] == near
    assert column.inside == 7


def test_texts_and_names_are_read_once_a_file(said: list[str]) -> None:
    found = Found("SYNTHETIC")
    for number in range(50):
        found.add(f"log/s{number}", TIME[:20], label=f"S{number}")
        found.text(f"remark {number}", f"of the file {number}")
        found.text(f"log/title {number}", f"of the log {number}")
    columns_of([stored("file.mat", found)])
    # Labels, names, remarks and titles; the log and the file.
    assert len(said) == 50 + 50 + 50 + 50 + 2


@given(st.text(max_size=40))
def test_what_is_shown_is_one_printable_line(text: str) -> None:
    shown = printable(text)
    assert len(shown) == len(text)
    assert shown.isprintable()
    assert all(after == before for before, after in zip(text, shown, strict=True) if before.isprintable())


@given(step=st.floats(1.001e-4, 0.0999), unit=st.sampled_from(["s", "ms", "us", "ns"]))
def test_the_step_of_a_loop_tells_its_unit(step: float, unit: str) -> None:
    times = step * np.arange(5000.0) / FACTORS["time"][unit]
    clock = guessed(source("x.csv", {"t": times, "q2": np.resize(course(2), 5000)}))["t"]
    assert clock.unit == unit
    assert clock.doubts


@pytest.mark.parametrize(
    ("name", "end", "uneven"), [("time", 10.0, True), ("time", 120.0, False), ("tout", 5000.0, True)]
)
def test_the_steps_of_a_solver_are_in_seconds(name: str, end: float, uneven: bool) -> None:
    steps = np.geomspace(1.0, 50.0 if uneven else 1.0, 60)
    times = end * np.append(0.0, np.cumsum(steps)) / steps.sum()
    clock = guessed(source("out.mat", {name: times, "q2": course(2)[: len(times)]}))[name]
    assert (clock.quantity, clock.unit, not clock.doubts) == ("time", "s", name == "tout")


@pytest.mark.parametrize(
    ("names", "unit", "moves", "kind"),
    [
        (("e1", "e2", "e3"), None, False, None),
        (("error", "error 2", "error 3"), None, False, None),
        (("error 1", "error 2", "error 3"), None, False, "error"),
        (("e1", "e2", "e3"), "deg", False, "error"),
        (("e1", "e2", "e3"), None, True, "error"),
    ],
)
def test_constants_are_angles_by_a_name_a_unit_or_a_motion_beside(
    names: tuple[str, ...], unit: str | None, moves: bool, kind: str | None
) -> None:
    values = [np.full(4000, size) for size in (1.2, 0.4)] + [0.7 + moves * followed(2)]
    signals = dict(zip(names, values, strict=True))
    found = guessed(
        source("x.csv", {"t": TIME} | signals, **dict.fromkeys(names if unit else (), unit or ""))
    )
    assert found[names[0]].quantity == kind


def test_a_stated_unit_of_time_is_no_doubt() -> None:
    for unit in ("us", "微秒", "microsecond", "µsec"):
        clock = guessed(source("x.csv", {"t": TIME, "q2": course(2)}, t=unit))["t"]
        assert clock.unit == "us"
        assert not clock.doubts


@pytest.mark.parametrize(
    "values", [np.zeros(100), np.repeat([0.0, 30.0], 50), np.arange(100.0), np.full(100, 0.5)]
)
def test_what_is_no_label(values: Array) -> None:
    assert not is_label(values)


def test_joints_counted_from_zero_are_moved_everywhere() -> None:
    sources = [
        source(f"{name}.csv", {"t": TIME} | {f"q{k}": followed(k + 1) for k in joints})
        for name, joints in (("decoupling", (0, 1, 2)), ("c1", (1, 2)))
    ]
    columns = understand(sources)
    assert [column.joint for column in columns if column.quantity == "measured"] == [1, 2, 3, 2, 3]
    suggestion = suggest(columns, "SYNTHETIC")
    assert suggestion.runs == {"controller_1": 2, "decouple": 3}
    (remark,) = [remark for remark in suggestion.remarks if "counted from 0" in remark]
    assert remark.startswith("controller_1, decouple: ")


@pytest.mark.parametrize(
    ("file", "written", "joints"),
    [
        ("c1", (1, 2), (2, 3)),
        ("decoupling", (1, 2), (1, 2)),
        ("c1", (2,), (2,)),
        ("c1", (2, 3), (2, 3)),
        ("c1", (0, 2), (None, 2)),
        ("c1", (0, 1, 2, 3), (None, 1, 2, 3)),
    ],
)
def test_joints_counted_from_one_are_moved(
    file: str, written: tuple[int, ...], joints: tuple[int | None, ...]
) -> None:
    """A nought alone, or beside joint 3, may stand for a start."""
    found = guessed(source(f"{file}.csv", {"t": TIME} | {f"q{k}": followed(k or 1) for k in written}))
    assert tuple(found[f"q{k}"].joint for k in written) == joints
