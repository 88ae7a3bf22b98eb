"""What is guessed from names and numbers, and the mapping that is suggested from it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tendonrepro.arithmetic import coupling_of, table_1
from tendonrepro.dataset import columns as columns_module
from tendonrepro.dataset.columns import Column, columns_of
from tendonrepro.dataset.evidence import counted_in, difference_of, sampling_step
from tendonrepro.dataset.mapping import load_mapping
from tendonrepro.dataset.meaning import understand
from tendonrepro.dataset.signals import Found, Source
from tendonrepro.dataset.suggestion import suggest, variable_of
from tendonrepro.dataset.units import FACTORS, plain_unit
from tendonrepro.dataset.words import Hints, hints, printable
from tendonrepro.published import published

Array = NDArray[np.float64]

S, S_INV = coupling_of(table_1(published()))
TIME = 0.001 * np.arange(4000.0)
COUNT = 360.0 / 16384.0


def course(joint: int) -> Array:
    """A smooth motion in degrees, another one for each joint."""
    return (20.0 + 4.0 * joint) * 0.5 * (1.0 - np.cos(2.0 * np.pi * TIME / (1.5 + 0.5 * joint)))


def followed(joint: int, size: float = 0.3) -> Array:
    """What an encoder in degrees reads of it."""
    late = course(joint) - size * np.sin(2.0 * np.pi * TIME / 1.1 + joint)
    return COUNT * np.round(late / COUNT)


def source(name: str, signals: Mapping[str, Array], group: str = "", **unit: str) -> Source:
    found = Found("SYNTHETIC")
    for path, values in signals.items():
        found.add(path, values, group=group, unit=unit.get(path))
    return Source(name, "SYNTHETIC", 0, "0" * 32, tuple(found.signals), tuple(found.skipped))


def guessed(*sources: Source) -> dict[str, Column]:
    columns = understand(sources, S_INV)
    return {
        f"{column.signal.path}{f'[{column.number}]' if column.signal.columns > 1 else ''}": column
        for column in columns
    }


@pytest.mark.parametrize(
    ("name", "quantity", "joint"),
    [
        ("q2_des", "desired", 2),
        ("qd3", "desired", 3),
        ("theta2_d", "desired", 2),
        ("DesiredAngle2", "desired", 2),
        ("期望角度2", "desired", 2),
        ("关节3 实际", "measured", 3),
        ("J3_actual", "measured", 3),
        ("Joint 2 (deg)", "measured", 2),
        ("e2", "error", 2),
        ("tracking error joint 3", "error", 3),
        ("tau_m2", "torque", 2),
        ("Ĥ3", "estimate", 3),
        ("sliding surface 2", "surface", 2),
        ("Motor 3 angle", "motor", 3),
        ("q_calc2", "calculated", 2),
        ("dq2", "rate", 2),
        ("time (s)", "time", None),
        ("t", "time", None),
        ("column 3", None, None),
        ("data2", None, None),
    ],
)
def test_names_of_columns(name: str, quantity: str | None, joint: int | None) -> None:
    said = hints(name)
    assert (said.quantity, said.joint) == (quantity, joint)


@pytest.mark.parametrize(
    ("name", "controller", "payload"),
    [
        ("Controller 1", 1, None),
        ("ctrl3", 3, None),
        ("α-TDE-NTSM", 1, None),
        ("TDE-NTSM_noload", 2, 0.0),
        ("TDE-TSM", 3, None),
        ("c1_200g", 1, 0.2),
        ("控制器2", 2, None),
        ("Controller1 0.2kg", 1, 0.2),
        ("without load", None, 0.0),
        ("fig14", None, None),
    ],
)
def test_names_of_runs(name: str, controller: int | None, payload: float | None) -> None:
    said = hints(name)
    assert (said.controller, said.payload_mass) == (controller, payload)


def test_a_load_without_a_weight_is_a_load() -> None:
    assert np.isnan(hints("with payload").payload_mass or 0.0)


@given(st.text(max_size=40))
def test_any_name_can_be_read(name: str) -> None:
    said = hints(name)
    assert said.joint in {None, 1, 2, 3}


def test_units_as_people_write_them() -> None:
    written = {
        "°": "deg",
        "Degrees": "deg",
        "(rad)": "rad",
        "N·m": "N m",
        "Nm": "N m",
        "ms": "ms",
        "sec": "s",
    }
    assert {text: plain_unit(text) for text in written} == written
    assert plain_unit("furlong") is None
    assert all(plain_unit(unit) == unit for units in FACTORS.values() for unit in units)


def test_steps_of_a_time_axis() -> None:
    assert sampling_step(TIME) == pytest.approx(0.001)
    assert sampling_step(TIME[::-1]) is None
    assert sampling_step(course(2)) is None
    assert sampling_step(TIME**2) is None


@pytest.mark.parametrize("offset", [0.0, 0.011, 7.3])
def test_the_encoder_tells_degrees_from_radians(offset: float) -> None:
    assert counted_in(followed(2) + offset) == "deg"
    assert counted_in(np.deg2rad(followed(2)) + offset) == "rad"
    assert counted_in(course(2)) is None
    assert counted_in(np.round(course(2))) is None


@given(sign=st.sampled_from([1.0, -1.0]), size=st.floats(0.01, 3.0))
def test_a_difference_is_recognised_with_its_sign(sign: float, size: float) -> None:
    a, b = course(2), course(2) - size * np.sin(TIME)
    found = difference_of(sign * (a - b), {"a": a, "b": b, "c": course(3)})
    assert found == (("a", "b") if sign > 0.0 else ("b", "a"))


@pytest.mark.parametrize("hole", [np.nan, np.inf])
def test_columns_without_numbers_prove_nothing(hole: float) -> None:
    """Neither a difference nor a unit, and no warning of the arithmetic either."""
    empty = np.full(len(TIME), hole)
    noise = np.random.default_rng(2).normal(size=(2, len(TIME)))
    assert difference_of(noise[0], {"a": empty, "b": noise[1]}) is None
    assert difference_of(empty, {"a": noise[0], "b": noise[1]}) is None
    seven = np.where(np.arange(len(TIME)) < 7, noise[1] + noise[0], hole)
    assert difference_of(noise[0], {"a": seven, "b": noise[1]}) is None
    found = guessed(source("x.csv", {"t": TIME, "aa": noise[0], "bb": empty, "cc": 5.0 * noise[1]}, "g"))
    assert [found[name].quantity for name in ("aa", "bb", "cc")] == [None, None, None]


@pytest.mark.parametrize("name", ["e2", "q2", "motor 2"])
def test_a_column_without_numbers_settles_no_unit(name: str) -> None:
    column = guessed(source("x.csv", {"t": TIME, name: np.full(len(TIME), np.nan)}, "g"))[name]
    assert column.because[-1] == "rad: nothing says otherwise; look at it"


def test_a_difference_with_gaps_is_still_one() -> None:
    a, b = course(2), course(2) - np.sin(TIME)
    e = np.where(TIME < 1.0, np.nan, a - b)
    assert difference_of(e, {"a": a, "b": np.where(TIME > 3.0, np.nan, b)}) == ("a", "b")


def test_a_named_table_is_understood() -> None:
    signals = {"t": TIME, "qd2": course(2), "q2": followed(2), "qd3": course(3), "q3": followed(3)}
    found = guessed(source("controller1.csv", signals, group="table"))
    assert {path: (column.quantity, column.joint) for path, column in found.items()} == {
        "t": ("time", None),
        "qd2": ("desired", 2),
        "q2": ("measured", 2),
        "qd3": ("desired", 3),
        "q3": ("measured", 3),
    }
    assert {column.unit for path, column in found.items() if path != "t"} == {"deg"}
    assert found["t"].unit == "s"
    assert found["q2"].time == found["t"].address


def test_numbers_alone_tell_time_desired_measured_and_error() -> None:
    table = np.stack([TIME, course(2), followed(2), course(2) - followed(2)], axis=1)
    found = guessed(source("c2.npy", {"array": table}))
    kinds = [found[f"array[{number}]"].quantity for number in (1, 2, 3, 4)]
    assert kinds == ["time", "desired", "measured", "error"]
    assert all(column.because for column in found.values())


@pytest.mark.parametrize("unit", ["deg", "rad"])
@pytest.mark.parametrize("quantised", [True, False])
def test_degrees_and_radians(unit: str, quantised: bool) -> None:
    factor = 1.0 if unit == "deg" else np.pi / 180.0
    q = followed(2) if quantised else followed(2) + 1e-3 * np.sin(9.0 * TIME)
    found = guessed(source("x.csv", {"t": TIME, "qd2": factor * course(2), "q2": factor * q}, group="g"))
    assert found["qd2"].unit == found["q2"].unit == unit


def test_a_stored_unit_wins() -> None:
    found = guessed(source("x.csv", {"t": TIME, "q2": course(2)}, group="g", q2="rad"))
    assert found["q2"].unit == "rad"


def test_columns_without_numbers_are_joints_in_order() -> None:
    both = np.stack([course(2), course(3)], axis=1)
    found = guessed(source("controller3.mat", {"t": TIME, "q_des": both, "q": 0.99 * both}, group="g"))
    assert [found[f"q_des[{k}]"].joint for k in (1, 2)] == [2, 3]
    assert [found[f"q[{k}]"].joint for k in (1, 2)] == [2, 3]


@pytest.mark.parametrize("ratio", [1.0, 100.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_motor_angles_are_found_through_the_coupling(ratio: float, sign: float) -> None:
    q = np.stack([course(1), course(2), course(3)], axis=1)
    motors = sign * ratio * q @ S_INV.T
    names = (
        {"t": TIME} | {f"q{k + 1}": q[:, k] for k in range(3)} | {f"x_{k}": motors[:, k] for k in range(3)}
    )
    found = guessed(source("decoupling.csv", names, group="g"))
    motor = [found[f"x_{k}"] for k in range(3)]
    assert [column.quantity for column in motor] == ["motor"] * 3
    assert [column.joint for column in motor] == [1, 2, 3]
    assert [column.scale for column in motor] == [sign / ratio] * 3


def test_times_in_milliseconds() -> None:
    found = guessed(source("x.csv", {"t": 1e3 * TIME, "q2": course(2)}, group="g"))
    assert found["t"].unit == "ms"


def _record() -> list[Source]:
    """Three controllers and a payload run, a file each, named as people name files."""
    sources = []
    for number, load in [(1, ""), (2, ""), (3, ""), (1, "_0.2kg")]:
        signals = {"t": TIME}
        for joint, (name, angle) in product((2, 3), (("qd", course), ("q", followed))):
            signals[f"{name}{joint}"] = angle(joint)
        sources.append(source(f"record.zip/SYNTHETIC_ctrl{number}{load}.csv", signals, group="table"))
    return sources


def test_a_suggested_mapping_is_a_valid_one(tmp_path: Path) -> None:
    suggestion = suggest(understand(_record(), S_INV), "SYNTHETIC")
    path = tmp_path / "mapping.yaml"
    path.write_text(suggestion.text, encoding="utf-8")
    mapping = load_mapping(path).mapping
    assert list(mapping.runs) == ["controller_1", "controller_1_payload", "controller_2", "controller_3"]
    assert mapping.runs["controller_1_payload"].payload_mass_kg == 0.2
    for name, run in mapping.runs.items():
        assert {(entry.variable, entry.joint) for entry in run.signals} == set(
            product(("q_d", "q_encoder"), (2, 3))
        )
        assert all(entry.unit == "deg" and entry.because for entry in run.signals), name
        assert run.time is not None
        assert run.time.signal == "t"
    assert len(list(mapping.guesses())) == 16


def test_one_sheet_with_all_controllers_shares_what_belongs_to_none() -> None:
    signals = {"t": TIME, "qd2": course(2)} | {f"q2 C{n}": followed(2, 0.1 * n) for n in (1, 2, 3)}
    runs = suggest(understand([source("fig14.xlsx", signals, group="Sheet1")], S_INV), "SYNTHETIC").runs
    assert runs == {"controller_1": 2, "controller_2": 2, "controller_3": 2}


def test_joints_counted_from_one_are_moved() -> None:
    signals = {"t": TIME, "q1": course(2), "q2": course(3)}
    text = suggest(understand([source("controller1.csv", signals, group="g")], S_INV), "SYNTHETIC").text
    assert "joint: 3" in text
    assert "joint: 1\n" not in text


def test_what_has_no_run_is_listed() -> None:
    unknown = np.random.default_rng(5).normal(size=len(TIME))
    suggestion = suggest(
        understand([source("c1.csv", {"t": TIME, "q2": course(2), "zz": unknown}, "g")], S_INV), "x"
    )
    assert [column.signal.path for column in suggestion.left] == ["zz"]
    assert '#      signal: "zz"' in suggestion.text


def test_the_decoupling_experiment_is_told_from_the_comparison() -> None:
    signals = (
        {"t": TIME}
        | {f"motor{k}": course(k) for k in (1, 2, 3)}
        | {f"joint{k}": course(k) for k in (1, 2, 3)}
    )
    columns = understand([source("experiment.csv", signals, group="g")], S_INV)
    assert suggest(columns, "SYNTHETIC").runs == {"decouple": 6}


def test_motor_angles_from_desired_joint_angles_are_no_measurement() -> None:
    column = guessed(source("x.csv", {"t": TIME, "motor 2 desired": course(2)}, group="g"))["motor 2 desired"]
    assert variable_of(column) is None


# ---- Layouts that once were taken wrongly ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("theta_m2", "motor"),
        ("q_m3", "motor"),
        ("电机转角θm1", "motor"),
        ("计算关节角 θ1", "calculated"),
        ("θ2误差", "error"),
        ("时间/s", "time"),
        ("图15e 关节2力矩", "torque"),
        ("fig15e", None),
        ("q2_dot", "rate"),
        ("de2", "other"),
        ("dqd2", "rate"),
        ("sigma2", "surface"),
        ("Sample", "index"),
        ("e_2 (deg)", "error"),
    ],
)
def test_names_that_look_like_others(name: str, quantity: str | None) -> None:
    assert hints(name).quantity == quantity


@pytest.mark.parametrize(
    ("name", "controller", "payload"),
    [
        ("run_aTDE_NTSM", 1, None),
        ("a-TDE-NTSM", 1, None),
        ("proposed_payload", 1, float("nan")),
        ("Sheet1!G4:K2304", None, None),
        ("ctrl1_0p2kg", 1, 0.2),
        ("有载荷", None, float("nan")),
        ("无载荷", None, 0.0),
        ("withoutload", None, 0.0),
        ("图14a", None, None),
    ],
)
def test_names_of_runs_that_look_like_others(
    name: str, controller: int | None, payload: float | None
) -> None:
    said = hints(name)
    assert said.controller == controller
    assert said.payload_mass == pytest.approx(payload, nan_ok=True)


def test_variables_beside_each_other_in_a_file_share_their_time() -> None:
    """What `save` writes: no struct, no table, only variables of one length."""
    found = guessed(
        source("c1.mat", {"t": TIME, "q2": followed(2), "qd2": course(2), "x": course(2) - followed(2)})
    )
    assert {found[name].time for name in ("q2", "qd2", "x")} == {found["t"].address}
    assert found["x"].quantity == "error"


def test_a_time_apart_serves_columns_of_its_length() -> None:
    found = Found("SYNTHETIC")
    found.add("tout", TIME)
    found.add("scope/q2", followed(2), group="scope")
    columns = understand([Source("c1.mat", "SYNTHETIC", 0, "0" * 32, tuple(found.signals))], S_INV)
    assert columns[1].time == columns[0].address


def test_joint_angles_and_motor_angles_of_one_name_are_told_apart() -> None:
    q = np.stack([followed(1), followed(2), followed(3)], axis=1)
    motors = -100.0 * q @ S_INV.T
    for first, second in ((q, motors), (motors, q)):
        names = (
            {"t": TIME}
            | {f"Q{k + 1}": first[:, k] for k in range(3)}
            | {f"q{k + 1}": second[:, k] for k in range(3)}
        )
        found = guessed(source("x.csv", names, group="g"))
        of_motors = "Q" if first is motors else "q"
        for k in (1, 2, 3):
            assert found[f"{of_motors}{k}"].quantity == "motor"
            assert found[f"{of_motors}{k}"].scale == -0.01
            assert found[f"{'q' if of_motors == 'Q' else 'Q'}{k}"].quantity == "measured"


def test_the_same_joint_under_several_controllers_is_no_motor() -> None:
    names = {"t": TIME} | {f"控制器{n}(°)": followed(3, 0.1 * n) for n in (1, 2, 3)}
    found = guessed(source("图14b.csv", names, group="g"))
    kinds = {(column.quantity, column.joint) for path, column in found.items() if path != "t"}
    assert kinds == {("measured", 3)}


def test_what_turns_too_far_is_no_joint_angle() -> None:
    column = guessed(source("x.csv", {"t": TIME, "angle 2": 50.0 * course(2)}, group="g"))["angle 2"]
    assert column.quantity is None
    assert "no joint turns" in column.because[-1]


def test_a_sample_index_is_no_time() -> None:
    columns = understand(
        [source("c1.csv", {"Sample": np.arange(4000.0), "e2": 0.3 * np.cos(TIME)}, "g")], S_INV
    )
    suggestion = suggest(columns, "SYNTHETIC")
    assert "step_s: 0.001" in suggestion.text
    assert any("without a time" in remark for remark in suggestion.remarks)


def test_a_matrix_of_settings_is_no_record() -> None:
    found = guessed(source("x.mat", {"t": TIME, "S": S}))
    assert found["S[1]"].quantity is None


def test_figures_say_what_their_panels_show() -> None:
    sources = [
        source("fig14c.csv", {"t": TIME, "C1": course(2), "C2": course(3)}, "g"),
        source("fig15e.csv", {"t": TIME, "C1": course(2)}, "g"),
    ]
    columns = [column for column in understand(sources, S_INV) if column.quantity != "time"]
    assert [(c.quantity, c.joint, c.controller) for c in columns] == [
        ("error", 2, 1),
        ("error", 2, 2),
        ("torque", 2, 1),
    ]


def test_titles_name_what_stands_below_them() -> None:
    found = Found("SYNTHETIC")
    found.add("Sheet1!A3:B9/t", TIME, group="Sheet1!A3:B9")
    found.add("Sheet1!A3:B9/q2", followed(2), group="Sheet1!A3:B9")
    found.add("Sheet1!D3:E9/t", TIME, group="Sheet1!D3:E9")
    found.add("Sheet1!D3:E9/q2", followed(2), group="Sheet1!D3:E9")
    found.text("Sheet1!A3:B9/title", "Controller 2")
    found.text("Sheet1!D3:E9/title", "Controller 1, 0.2 kg payload")
    book = Source("x.xlsx", "SYNTHETIC", 0, "0" * 32, tuple(found.signals), texts=found.texts)
    assert suggest(understand([book], S_INV), "x").runs == {"controller_1_payload": 1, "controller_2": 1}


def test_texts_speak_nearest_first() -> None:
    found = Found("SYNTHETIC")
    found.add("a/b/q", TIME, label="x")
    places = {"a/title": "of a", "a/b/q/note": "of q", "other/b/title": "of others", "title": "of all"}
    for path, text in (places | {"a/b/title": "of b", "a/b/second": "more of b"}).items():
        found.text(path, text)
    near = ["q", "of q", "of b", "more of b", "of a", "b", "a", "file", "folder", "of all"]
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns_module, "hints", lambda name: Hints(figure=_noted(said, name)))
        (column,) = columns_of(
            [Source("folder/file.mat", "SYNTHETIC", 0, "0" * 32, tuple(found.signals), texts=found.texts)]
        )
    assert [said[hint.figure] for hint in column.around if hint.figure is not None] == near
    assert column.inside == 7


def _noted(said: list[str], name: str) -> int:
    said.append(name)
    return len(said) - 1


def test_texts_and_names_are_read_once_a_file() -> None:
    found = Found("SYNTHETIC")
    for number in range(50):
        found.add(f"log/s{number}", TIME[:20], label=f"S{number}")
        found.text(f"remark {number}", f"of the file {number}")
        found.text(f"log/title {number}", f"of the log {number}")
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns_module, "hints", lambda name: Hints(figure=_noted(said, name)))
        columns_of([Source("file.mat", "SYNTHETIC", 0, "0" * 32, tuple(found.signals), texts=found.texts)])
    # Labels, names, remarks and titles; the log and the file.
    assert len(said) == 50 + 50 + 50 + 50 + 2


def test_two_columns_for_one_place_are_told_of() -> None:
    sources = [
        source(f"{folder}/c1.csv", {"t": TIME, "q2": followed(2, size)}, "g")
        for folder, size in (("a", 0.1), ("b", 0.2))
    ]
    remarks = suggest(understand(sources, S_INV), "SYNTHETIC").remarks
    assert any("2 columns claim to be q_encoder 2 of controller_1" in remark for remark in remarks)
    twice = [source(f"{folder}/c1.csv", {"t": TIME, "q2": followed(2)}, "g") for folder in "ab"]
    assert not suggest(understand(twice, S_INV), "SYNTHETIC").remarks


def test_comparisons_counted_from_one_beside_a_decoupling_record() -> None:
    comparison = {"t": TIME, "q1": followed(2), "q2": followed(3), "qd1": course(2), "qd2": course(3)}
    others = (
        {"t": TIME} | {f"q{k}": followed(k) for k in (1, 2, 3)} | {f"motor{k}": course(k) for k in (1, 2, 3)}
    )
    sources = [source("c2.csv", comparison, "g"), source("jieou.csv", others, "g")]
    suggestion = suggest(understand(sources, S_INV), "SYNTHETIC")
    assert suggestion.runs == {"controller_2": 4, "decouple": 6}
    assert suggestion.text.count("as in section 5.4") == 4


@given(st.text(max_size=40))
def test_what_is_shown_is_one_printable_line(text: str) -> None:
    shown = printable(text)
    assert len(shown) == len(text)
    assert shown.isprintable()
    assert all(after == before for before, after in zip(text, shown, strict=True) if before.isprintable())
