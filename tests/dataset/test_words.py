# ruff: noqa: E501
"""What names say: words in three languages, units, runs, and what is asked instead of guessed."""

import math
from importlib.resources import files
from pathlib import Path

import pytest

from tendonrepro.configuration.strict_yaml import load, read_text
from tendonrepro.dataset.words import FACTORS, meaning_of, plain_unit, variable_of

WORDS = Path(str(files("tendonrepro") / "dataset" / "words.yaml"))
# Name of a column: variable, joint, unit.
COLUMNS = {
    "q2_des": ("q_d", 2, None), "qd3": ("q_d", 3, None), "theta2_d": ("q_d", 2, None),
    "DesiredAngle2": ("q_d", 2, None), "期望角度2": ("q_d", 2, None), "q2_ref [rad]": ("q_d", 2, "rad"),
    "Sollwinkel 2 [°]": ("q_d", 2, "deg"), "Winkel Gelenk 3 soll / °": ("q_d", 3, "deg"),
    "关节3 实际": ("q_encoder", 3, None), "J3_actual": ("q_encoder", 3, None), "Joint 2 (deg)": ("q_encoder", 2, "deg"),
    "Istwinkel 2 (rad)": ("q_encoder", 2, "rad"), "q2": ("q_encoder", 2, None), "q2_deg": ("q_encoder", 2, "deg"),
    "e2": ("e", 2, None), "tracking error joint 3": ("e", 3, None), "θ2误差": ("e", 2, None),
    "Regelfehler 2 (mrad)": ("e", 2, "mrad"), "e_2 (deg)": ("e", 2, "deg"),
    "tau_m2": ("tau_m", 2, None), "Drehmoment 2 [Nm]": ("tau_m", 2, "N m"), "关节2力矩 (N·m)": ("tau_m", 2, "N m"),
    "Ĥ3": ("H_hat", 3, None), "H_hat2": ("H_hat", 2, None), "sliding surface 2": ("s", 2, None), "s2": ("s", 2, None),
    "Motor 3 angle": ("q_motor_encoder", 3, None), "theta_m2": ("q_motor_encoder", 2, None),
    "电机转角θm1": ("q_motor_encoder", 1, None), "q_calc2": ("q_calculated", 2, None), "dq2": ("dq", 2, None),
    "time (s)": ("time", None, "s"), "时间/s": ("time", None, "s"), "t": ("time", None, None),
    "Zeit / ms": ("time", None, "ms"), "Time_s": ("time", None, "s"),
    "dq2 deg/s": ("dq", 2, "deg/s"), "q2 velocity / rad/s": ("dq", 2, "rad/s"), "motor torque 2/Nm": ("tau_m", 2, "N m"),
}  # fmt: skip
# Names that say too little, or too much to be sure.
ASKED = [
    "qd2-q2 (deg)", "load torque 2", "q2_take3", "Integral error 2", "joint 2 (motor 3)", "velocity error 2",
    "Joint 2 desired - actual", "关节2误差平方", "q2_dot", "∫e2", "column 3", "data2", "Sample", "desired torque 2",
    "Filtered q2", "q2_s", "q2 модель", "motor 2 torque angle", "motor 2 velocity (deg/s)", "Motor1Vel Speed", "dtheta_m2",
    "电机2速度", "tip velocity 2 (m/s)", "velocity 2 m/s", "position 2 (m)", "q2/V", "q2_V", "motor 2 (mV)", "motor voltage 2",
    "Motorstrom 2", "关节2电压", "encoder 2 (%)", "关节2角加速度", "joint 2 (m/s^2)", "t (1/s)", "ddq2",
    "ddq_d[2]",
]  # fmt: skip
# Name of a run: controller, payload in kg.
LOADED = math.nan
RUNS = {
    "Controller 1": (1, None), "ctrl3": (3, None), "α-TDE-NTSM": (1, None), "a-TDE-NTSM": (1, None),
    "run_aTDE_NTSM": (1, None), "TDE-NTSM_noload": (2, 0.0), "TDE-TSM": (3, None), "控制器2": (2, None),
    "c1_200g": (1, 0.2), "ctrl1_0p2kg": (1, 0.2), "Controller1 0.2kg": (1, 0.2), "proposed_payload": (1, LOADED),
    "有载荷": (None, LOADED), "TDE-NTSM without alpha": (2, None), "C1 w/o load": (1, 0.0), "C1 w load": (1, LOADED),
    "NTSM (no load)": (2, 0.0), "C1 payload 0": (1, 0.0), "控制器1空载": (1, 0.0), "C1 0,2kg": (1, 0.2),
    "Regler 2 mit Nutzlast": (2, LOADED), "Regler 1 ohne Last": (1, 0.0), "fig14": (None, None),
    "Kinematic Decoupling and alpha-TDE-NTSM Control": (None, None),
}  # fmt: skip


@pytest.mark.parametrize("name", COLUMNS)
def test_names_of_columns(name):
    said = meaning_of(name)
    assert (variable_of(said.says), said.joint, said.unit) == COLUMNS[name]
    assert not said.unknown


@pytest.mark.parametrize("name", ASKED)
def test_what_is_not_sure_is_asked(name):
    said = meaning_of(name)
    assert said.unknown or variable_of(said.says) is None


@pytest.mark.parametrize("name", ["mat_3d", "3d", "D", "run_m1", "E2", "test d"])
def test_a_letter_of_a_file_or_sheet_says_nothing(name):
    said = meaning_of(name, around=True)
    assert variable_of(said.says) is None
    assert said.joint is None


def test_an_index_of_a_file_or_sheet_counts_beside_its_symbol_or_unit():
    assert variable_of(meaning_of("q_d", around=True).says) == "q_d"
    assert variable_of(meaning_of("fig14d controller 2 e 3 deg", around=True).says) == "e"


@pytest.mark.parametrize("name", RUNS)
def test_names_of_runs(name):
    controller, payload = RUNS[name]
    said = meaning_of(name)
    assert said.controller == controller
    assert said.payload == pytest.approx(payload, nan_ok=True)


def test_a_word_stands_in_one_group():
    """Of two, the later would win without a word."""
    groups = load(read_text(WORDS), str(WORDS))["words"]
    words = [word for group in groups.values() for word in group]
    assert len(words) > 100
    assert len(words) == len({*words})


def test_a_run_of_two_controllers_is_asked():
    assert meaning_of("controller1_TDE-TSM").unknown


def test_units_as_people_write_them():
    written = {
        "°": "deg",
        "Degrees": "deg",
        "(rad)": "rad",
        "N·m": "N m",
        "Nm": "N m",
        "sec": "s",
        "µs": "us",
    }
    assert {text: plain_unit(text) for text in written} == written
    assert plain_unit("furlong") is None
    assert all(plain_unit(unit) == unit for units in FACTORS.values() for unit in units)
