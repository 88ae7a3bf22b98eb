"""Statistics gathered sample by sample, and those of a trace, equal those of whole signals by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tendonrepro.arrays import Array
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import statistics
from tendonrepro.simulation.streaming import STATISTICS, SUMS, add_sample, finished, thresholds

T, N, PERIOD, L = 400, 2, 150, 10e-3
START = 200  # samples of 2 s


@pytest.fixture
def signals() -> dict[str, Array]:
    rng = np.random.default_rng(3)
    # Beside every turn there is a sample at 0.8 % of the peak speed, and one at 5.03 %.
    t = (np.arange(T)[:, np.newaxis] + 0.2) / PERIOD
    smooth = {"dq_d": np.sin(2 * np.pi * t) * [1.0, 2.0], "ddq_d": np.cos(2 * np.pi * t) * [3.0, 1.0]}
    return smooth | {name: rng.normal(size=(T, N)) for name in ("e", "de", "s", "tau", "H_hat", "epsilon")}


def gathered(x: dict[str, Array], live: Array) -> dict[str, Array]:
    phases = thresholds(x["dq_d"], x["ddq_d"], L, PERIOD)
    sums = {name: np.zeros(N) for name in SUMS}
    for k in range(T):
        sample = {name: x[name][k] for name in ("e", "de", "dq_d", "ddq_d", "s", "tau")}
        sample |= {"H": x["H_hat"][k], "saturated": 1.0 * (x["tau"][k] > 1.0)}
        sample["tau_before"] = x["tau"][k - 1] if k else np.zeros(N)
        sample["epsilon"] = x["epsilon"][k - 1] if k else np.zeros(N)
        sums = add_sample(sums, sample, live[k], float(k), phases)
    return finished(sums, live.sum(), np.zeros(N))


def by_hand(x: dict[str, Array]) -> dict[str, Array]:
    size, tau = np.abs(x["e"]), x["tau"]
    up = x["dq_d"] > 0.05 * np.abs(x["dq_d"]).max(axis=0)
    down = x["dq_d"] < -0.05 * np.abs(x["dq_d"]).max(axis=0)
    rapid = np.abs(x["ddq_d"]) > 0.5 * np.abs(x["ddq_d"]).max(axis=0)

    def mean(values: Array, where: Array) -> Array:
        return np.array([values[where[:, i], i].mean() for i in range(N)])

    def rms(values: Array) -> Array:
        return np.sqrt(np.mean(values**2, axis=0))

    found = {
        "mae": size.mean(axis=0),
        "rmse": rms(x["e"]),
        "max_error": size.max(axis=0),
        "mae_late": size[PERIOD:].mean(axis=0),
        "rmse_late": rms(x["e"][PERIOD:]),
        "mae_settled": size[START:].mean(axis=0),
        "rmse_settled": rms(x["e"][START:]),
        "mae_rapid": mean(size, rapid),
        "mae_calm": mean(size, ~rapid),
        "overshoot": overshoot(x["e"], x["dq_d"] / np.abs(x["dq_d"]).max(axis=0)),
        "s_rms": rms(x["s"]),
        "s_slow_rms": rms(slow(x["s"])),
        "s_max": np.abs(x["s"]).max(axis=0),
        "rate_max": np.abs(x["de"]).max(axis=0),
        "torque_step_rms": rms(np.diff(tau, axis=0)),
        "epsilon_rms": rms(x["epsilon"][:-1]),
        "epsilon_slow_rms": rms(slow(np.vstack([np.zeros(N), x["epsilon"][:-1]]))) * np.sqrt(T / (T - 1)),
        "epsilon_max": np.abs(x["epsilon"][:-1]).max(axis=0),
        "saturated": (tau > 1.0).mean(axis=0),
        "fast_share": np.zeros(N),
    }
    every = np.ones((T, N), dtype=bool)
    for name, values in (("torque", tau), ("H_hat", x["H_hat"])):
        for phase, where in (("", every), ("_up", up), ("_down", down)):
            found |= {
                f"{name}_rms{phase}": np.sqrt(mean(values**2, where)),
                f"{name}_peak{phase}": np.where(where, np.abs(values), 0.0).max(axis=0),
                f"{name}_slow{phase}": mean(np.abs(slow(values)), where),
            }
    return found


def slow(values: Array) -> Array:
    """First-order low-pass at 3 Hz: the exact response to a signal held between samples."""
    result = values.copy()
    for k in range(1, T):
        result[k] = values[k] + np.exp(-2.0 * np.pi * 3.0 * L) * (result[k - 1] - values[k])
    return result


def overshoot(e: Array, speed: Array) -> Array:
    """Error past the target, seen in the direction of the stroke before, while the reference rests.

    ``speed`` is that of the reference over its peak.
    """
    largest = np.zeros(N)
    for i in range(N):
        direction = 0.0
        for k in range(T):
            direction = float(np.sign(speed[k, i])) if abs(speed[k, i]) > 0.05 else direction
            if abs(speed[k, i]) <= 0.01:
                largest[i] = max(largest[i], -direction * e[k, i])
    return largest


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_statistics_are_those_of_the_signals(signals: dict[str, Array], sign: float) -> None:
    signals = {name: sign * values for name, values in signals.items()}
    found, expected = gathered(signals, np.ones(T)), by_hand(signals)
    assert tuple(found) == STATISTICS
    assert set(expected) == set(STATISTICS)
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, rel=1e-12), name
    variables = {"tau_m" if name == "tau" else name: values for name, values in signals.items()}
    of_trace = statistics(Trace("mine", np.arange(T) * L, (2, 3), variables, {}))
    # What is after the start is a window of the table; the others need more than signals.
    assert set(expected) - set(of_trace) == {*AFTER_THE_START, "rate_max", "saturated", "fast_share"}
    for name, values in of_trace.items():
        assert values == pytest.approx(expected[name], rel=1e-9), name


AFTER_THE_START = [name for name in STATISTICS if name.endswith(("_late", "_settled"))]


def test_a_run_that_ended_adds_nothing_even_when_it_is_not_finite(signals: dict[str, Array]) -> None:
    live = (np.arange(T) < 250).astype(float)
    ended = {name: values.copy() for name, values in signals.items()}
    for name in ("e", "de", "s", "tau", "H_hat", "epsilon"):
        ended[name][250:] = np.nan
    found = gathered(ended, live)
    size = np.abs(signals["e"][:250])
    assert found["mae"] == pytest.approx(size.mean(axis=0), rel=1e-12)
    assert found["mae_late"] == pytest.approx(size[PERIOD:].mean(axis=0), rel=1e-12)
    assert all(np.isfinite(values).all() for values in found.values())
    early = gathered(signals, (np.arange(T) < 30).astype(float))
    assert np.isnan(early["mae_late"]).all()
    assert np.isnan(early["mae_settled"]).all()
    assert thresholds(signals["dq_d"], signals["ddq_d"], L).period == T, "without a period nothing is late"
    for name in ("rms", "peak", "slow"):
        assert np.isnan(early[f"torque_{name}_down"]).all(), "a phase that never comes is not a number"
        assert np.isfinite(early[f"torque_{name}_up"]).all()


def test_a_course_below_the_frequency_stays_and_pulses_above_it_go(signals: dict[str, Array]) -> None:
    t = np.arange(T)[:, np.newaxis] * L
    course, pulses = 2.0 + np.sin(2.0 * np.pi * 0.5 * t), 3.0 * (-1.0) ** np.arange(T)[:, np.newaxis]
    pulses[0] = 0.0
    found = gathered(signals | {"tau": course + pulses + np.zeros(N)}, np.ones(T))
    assert found["torque_slow"] == pytest.approx(np.full(N, np.abs(course).mean()), rel=0.05)
    assert (found["torque_peak"] > 5.5).all()
