"""Trace files made from formulas alone: shaped like the real ones, quick to make, and never a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tendonrepro.configuration.load import shipped_folder
from tendonrepro.configuration.strict_yaml import load
from tendonrepro.results.paper import with_what_they_are
from tendonrepro.results.records import VARIABLES, PlantRecord, PlantValue, Trace, TraceFile

Array = NDArray[np.float64]

RISE, HOLD = 2.5, 2.0
PERIOD = 2.0 * (RISE + HOLD)
COUNT = np.deg2rad(0.022)
S_INV = np.array([[77.0, 0.0, 0.0], [-35.0, 77.0, 0.0], [35.0, -35.0, 37.0]]) / 37.0
S = np.linalg.inv(S_INV)
K_S = np.array([[150.0, -20.0], [-20.0, 50.0]])
RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload")
SHIPPED = (shipped_folder() / "compare.yaml").read_text()
"""Configuration that the files carry, so that their motion is the paper's."""
FEW = {"step": 0.05, "without": VARIABLES.keys() - {"q_encoder", "q_d", "e", "s", "tau_m"}}
"""What makes a file that is stored and read in a moment: each variable of each run takes its time."""
# Size of the error in degrees; deliberately not in the printed order on joint 3.
ERROR_DEG = {
    "controller_1": (0.20, 0.18),
    "controller_2": (0.22, 0.17),
    "controller_3": (0.25, 0.21),
    "controller_1_payload": (0.21, 0.19),
}


def make_compare_file(
    *,
    step: float = 0.01,
    periods: int = 2,
    runs: Sequence[str] = RUNS,
    diverged: Mapping[str, float] | None = None,
    without: Sequence[str] = (),
    source: str = "simulated",
) -> TraceFile:
    """Joints 2 and 3 on two periods of 30 deg up and down; `diverged` cuts a run at a time in s."""
    cut = diverged or {}
    made = {name: _compare_run(name, step, periods, cut.get(name), without) for name in runs}
    return _file("compare", source, made)


def make_decouple_file(*, step: float = 0.01, source: str = "simulated") -> TraceFile:
    """Run `decouple` (joints 1, 2, 3 in turn, then together) and run `pull_tendon_1` (motor 1 alone)."""
    made = {"decouple": _decouple_run(step), "pull_tendon_1": _pull_run(step)}
    return _file("decouple", source, made)


def _file(experiment: str, source: str, runs: dict[str, Trace]) -> TraceFile:
    file = TraceFile(
        experiment=experiment,  # type: ignore[arg-type]
        source=source,  # type: ignore[arg-type]
        title=f"synthetic {experiment}",
        runs=runs,
        plant=_plant(),
        config_yaml=SHIPPED,
        config_sha256="0" * 64,
        manifest={"seed": 1, "created": "2026-01-01T00:00:00Z", "tendonrepro_version": "0.1.0"},
    )
    return with_what_they_are(file, load(SHIPPED, "compare.yaml"))


def _plant() -> PlantRecord:
    routing = np.array([[77.0, 35.0, 35.0], [0.0, 77.0, 35.0], [0.0, 0.0, 37.0]]) * 1e-3
    values = {
        "S": PlantValue(S, "1", "derived: Eq. (2)", "coupling matrix"),
        "S_inv": PlantValue(S_INV, "1", "derived: Eq. (2)", "inverse coupling matrix"),
        "winch_diameter": PlantValue(np.full(3, 0.037), "m", "printed: Table 1", "winch diameter"),
        "pulley_diameter": PlantValue(routing, "m", "printed: Table 1", "pulley of joint, tendon"),
        "K_s": PlantValue(K_S, "N m rad-1", "assumed: test", "stiffness"),
        "mass": PlantValue(np.array([0.7, 0.45, 0.25]), "kg", "assumed: test", "link mass"),
        "length": PlantValue(np.array([0.3, 0.25, 0.2]), "m", "assumed: test", "link length"),
        "posture": PlantValue(np.deg2rad([40.0, 5.0, 0.0]), "rad", "assumed: test", "start posture"),
        "gravity": PlantValue(np.array(9.81), "m s-2", "assumed: test", "gravity"),
    }
    return PlantRecord(values, {"angle_convention": "from hanging, positive clockwise"})


def whole(file: TraceFile) -> TraceFile:
    """A file whose plant has a whole routing, as those of the commands have."""
    sign = np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    routing = {"sign": sign, "tensioner_diameter": np.array([0.035, 0.035, 0.037])}
    routing |= {"tensioner_force": np.array(12.0)}
    held = {key: PlantValue(value, "1", "test", key) for key, value in routing.items()}
    plant = PlantRecord({**file.plant.values, **held}, {"tensioner_side": "negative"})
    return replace(file, plant=plant)


def _up_and_down(time: Array) -> Array:
    """Minimum-jerk rise, hold, fall, hold of 1 rad, repeated."""
    phase = np.mod(time, PERIOD)
    x = np.clip(phase / RISE, 0.0, 1.0) - np.clip((phase - RISE - HOLD) / RISE, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x**2))


def _times(duration: float, step: float) -> Array:
    return np.arange(round(duration / step) + 1) * step


def _compare_run(name: str, step: float, periods: int, cut: float | None, without: Sequence[str]) -> Trace:
    time = _times(periods * PERIOD, step)
    q_d = np.deg2rad(30.0) * np.repeat(_up_and_down(time)[:, None], 2, axis=1)
    dq_d = np.gradient(q_d, step, axis=0)
    seed = RUNS.index(name) if name in RUNS else 99
    noise = np.random.default_rng(seed).standard_normal(q_d.shape)
    size = np.deg2rad(ERROR_DEG.get(name, (0.3, 0.3)))
    q = q_d - size * (np.tanh(dq_d / 0.05) + 0.3 * np.sin(2.0 * np.pi * time / 1.7)[:, None])
    if cut is not None:
        growth = np.exp(np.minimum((time - cut) / 0.1, 5.0)) * np.sin(40.0 * (time - cut) + 1.6)
        q += np.deg2rad(11.0) * growth[:, None]
    q_encoder = np.round(q / COUNT) * COUNT
    e = q_d - q_encoder
    H = 3.0 * np.sin(q + 0.8) + 0.2 * np.tanh(dq_d / 0.02)
    # One encoder count through M_bar / L^2 is a pulse of 3.84 N m.
    pulses = 3.84 * (np.abs(noise) > 2.0) * np.sign(noise)
    values = {
        **{"q": q, "dq": np.gradient(q, step, axis=0), "q_encoder": q_encoder, "q_d": q_d, "dq_d": dq_d},
        **{"ddq": np.gradient(dq_d, step, axis=0), "ddq_d": np.gradient(dq_d, step, axis=0), "e": e},
        **{"theta": q + H / 100.0, "dtheta": dq_d, "s": np.gradient(e, step, axis=0) * 0.1 + 1.9 * e},
        **{"H": H, "H_hat": H + pulses, "epsilon": pulses / 0.01, "tau_s": H},
        **{"tau_cmd": H + pulses + 0.01, "tau_m": H + pulses + 0.01},
    }
    stop = len(time) if cut is None else int(np.searchsorted(time, cut)) + 1
    kept = {key: values[key][:stop] for key in VARIABLES if key in values and key not in without}
    status = "ok" if cut is None else "diverged"
    return Trace(name, time[:stop], (2, 3), kept, _compare_attributes(name, status, float(time[stop - 1])))


def _compare_attributes(name: str, status: str, status_time: float) -> dict[str, object]:
    return {
        "law": name.removesuffix("_payload"),
        "gains": {"M_bar": [0.01, 0.01], "lam": [8.0, 8.0], "alpha": [0.1, 0.2]},
        "readings": {"weights": "interpolating", "phi_negative": "odd"},
        "payload_mass": 0.2 if name.endswith("payload") else 0.0,
        "status": status,
        "status_time": status_time,
        "reference_period": PERIOD,
    }


def _decouple_trace(name: str, time: Array, q: Array, q_motor: Array) -> Trace:
    step = float(time[1])
    count = np.deg2rad(360.0 / 819200.0)
    q_motor_encoder = np.round(q_motor / count) * count
    q_encoder = np.round(q / COUNT) * COUNT
    dq = np.gradient(q, step, axis=0)
    values = {
        **{"q": q, "dq": dq, "ddq": np.gradient(dq, step, axis=0), "q_encoder": q_encoder},
        **{"theta": q_motor @ S.T, "q_d": q, "dq_d": dq, "e": q - q_encoder},
        **{"tau_m": np.sin(q), "tau_s": np.sin(q)},
        **{"q_motor": q_motor, "q_motor_encoder": q_motor_encoder, "q_calculated": q_motor_encoder @ S.T},
    }
    attributes = {
        "law": "position_loop",
        "gains": {"stiffness": [1600.0] * 3, "damping": [18.0] * 3},
        "readings": {},
        "payload_mass": 0.0,
        "status": "ok",
        "status_time": float(time[-1]),
        "reference_period": 0.0,
    }
    return Trace(name, time, (1, 2, 3), {key: values[key] for key in VARIABLES if key in values}, attributes)


def _decouple_run(step: float) -> Trace:
    time = _times(4.0 * PERIOD, step)
    turn = np.minimum(time // PERIOD, 3)
    moves = np.stack([(turn == joint) | (turn == 3) for joint in range(3)], axis=1)
    q = np.deg2rad(30.0) * _up_and_down(time)[:, None] * moves
    stretch = np.deg2rad([0.05, 0.12, 0.3]) * np.sin(q) * np.array([1.0, 1.1, 1.2])
    return _decouple_trace("decouple", time, q, (q + stretch) @ S_INV.T)


def _pull_run(step: float) -> Trace:
    time = _times(PERIOD, step)
    q_motor = np.deg2rad(60.0) * _up_and_down(time)[:, None] * np.array([1.0, 0.0, 0.0])
    return _decouple_trace("pull_tendon_1", time, q_motor @ S.T, q_motor)
