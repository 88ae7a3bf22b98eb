"""A sweep as text for a terminal, and what it says about the paper's claims on the estimate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.console import columns
from tendonrepro.results.summary import CONTROLLERS

_FIRST, _SECOND, _ = CONTROLLERS


def sweep_text(data: Mapping[str, Any]) -> str:
    """Text of what a sweep found.

    Parameters
    ----------
    data : mapping
        As :func:`tendonrepro.experiments.sweep.command.run_sweep` returns it.

    Returns
    -------
    str
    """
    keys = " and ".join(axis["key"] for axis in data["keys"])
    if data.get("dry_run"):
        plan = columns([(label, f"{samples} samples") for label, samples in data["samples"].items()])
        head = f"sweep over {keys}: {len(data['samples'])} points of {len(data['runs'])} runs are valid"
        return f"{head}\n{plan}\nwould write to {data['out']}"
    parts = [f"Sweep over {keys}: MAE of each joint, deg", _errors(data), *data["findings"]]
    return "\n\n".join(["\n".join(parts[:2]), *parts[2:], f"Table and figures are in {data['out']}"])


def _errors(data: Mapping[str, Any]) -> str:
    joints, pairs = data["joints"], list(data["points"][0]["ratio"])
    head = ["", *(f"{_short(run)} {joint}" for run in data["runs"] for joint in joints)]
    head += [f"{pair.upper().replace('_', '/')} {joint}" for pair in pairs for joint in joints]
    rows, ends = [head], [""]
    for point in data["points"]:
        cells = [
            _number(point["runs"][run]["mae_deg"][k]) for run in data["runs"] for k in range(len(joints))
        ]
        cells += [_number(point["ratio"][pair][k]) for pair in pairs for k in range(len(joints))]
        rows.append([point["label"], *cells])
        ended = {_short(run): found["status"] for run, found in point["runs"].items()}
        ends.append(", ".join(f"{run} {status}" for run, status in ended.items() if status != "ok"))
    lines = columns(rows).splitlines()
    return "\n".join(f"{line}  {end}".rstrip() for line, end in zip(lines, ends, strict=True))


def _short(run: str) -> str:
    return run.replace("controller_", "C").replace("_", " ")


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"


def findings(data: Mapping[str, Any]) -> list[str]:
    """Sentences on claims E1 to E3, of sweeps over ``alpha``, the sampling period or ``M_bar``.

    Parameters
    ----------
    data : mapping
        With ``keys``, ``points``, ``joints``.

    Returns
    -------
    list of str
        One per key that a claim is about; none for other keys. With two keys the other one is held at
        the first value at which most runs are ok.
    """
    found = []
    for place, axis in enumerate(data["keys"]):
        speak = _SENTENCES.get(axis["key"].removesuffix(".value"))
        if speak is None or axis["numbers"] is None:
            continue
        chosen, at = _held(data, place)
        order = sorted(chosen, key=lambda point: axis["numbers"][point["places"][place]])
        x = np.array([axis["numbers"][point["places"][place]] for point in order])
        found.append(speak(order, x, data["joints"]).replace("@", at))
    return found


def _held(data: Mapping[str, Any], place: int) -> tuple[list[Mapping[str, Any]], str]:
    """Points to compare along one key, and the value of the other key in words."""
    if len(data["keys"]) == 1:
        return list(data["points"]), ""
    rest = 1 - place
    other = data["keys"][rest]
    slices: list[list[Mapping[str, Any]]] = [[] for _ in other["texts"]]
    for point in data["points"]:
        slices[point["places"][rest]].append(point)

    def lasting(k: int) -> int:
        return sum(found["status"] == "ok" for point in slices[k] for found in point["runs"].values())

    best = max(range(len(slices)), key=lasting)
    return slices[best], f" (at {other['key']}={other['texts'][best]})"


def _alpha(points: Sequence[Mapping[str, Any]], x: Array, joints: Sequence[int]) -> str:
    kept = _ok(points, (_FIRST, _SECOND))
    if len(kept) < 2:
        return "On alpha@ nothing can be said: it takes Controllers 1 and 2, both ok at two values or more."
    ratio = {
        name: np.array([_of(points[i], _FIRST, name) / _of(points[i], _SECOND, name) for i in kept])
        for name in ("epsilon_rms", "mae_deg", "overshoot_deg")
    }
    ratio["slow"] = np.array([points[i]["predicted_ratio"]["c1_c2"] for i in kept])

    def spans(name: str) -> str:
        return _each(joints, lambda k: f"from {ratio[name][0, k]:.2f} to {ratio[name][-1, k]:.2f}")

    better = _each(joints, lambda k: "lowers" if ratio["epsilon_rms"][-1, k] < 1.0 else "does not lower")
    return (
        f"Claims E1 and E3, alpha from {_list(x[kept[0]])} to {_list(x[kept[-1]])}@, Controller 1 over "
        f"Controller 2: RMS of epsilon {spans('epsilon_rms')}, MAE {spans('mae_deg')} (a slowly changing "
        f"load: {spans('slow')}), overshoot {spans('overshoot_deg')}; at the largest value alpha {better} "
        "the error of the estimate."
    )


def _period(points: Sequence[Mapping[str, Any]], x: Array, joints: Sequence[int]) -> str:
    run = _judged(points)
    slopes = _slopes(points, run, x, ("mae_deg", "epsilon_rms"))
    if slopes is None:
        return f"On the delay L@ nothing can be said: it takes {run} to be ok at two values or more."
    better = _each(joints, lambda k: "improves" if slopes["epsilon_rms"][k] > 0.0 else "does not improve")
    return (
        f"Claim E2, delay L@, {run}: slope of log MAE against log L {_plain(joints, slopes['mae_deg'])} "
        f"(a slowly changing load: 1), of the RMS of epsilon {_plain(joints, slopes['epsilon_rms'])}; "
        f"a smaller delay {better} the estimate."
    )


def _inertia(points: Sequence[Mapping[str, Any]], x: Array, joints: Sequence[int]) -> str:
    run = _judged(points)
    slopes = _slopes(points, run, x, ("mae_deg", "torque_step_rms"))
    if slopes is None:
        return f"On M_bar@ nothing can be said: it takes {run} to be ok at two values or more."
    smoother = _each(joints, lambda k: "smoother" if slopes["torque_step_rms"][k] > 0.0 else "no smoother")
    return (
        f"Claim E2, M_bar@, {run}: slope of log MAE against log M_bar {_plain(joints, slopes['mae_deg'])} "
        f"(a slowly changing load: -1), of the RMS torque step {_plain(joints, slopes['torque_step_rms'])}; "
        f"with a smaller M_bar the torque is {smoother}."
    )


_SENTENCES: Mapping[str, Callable[[Sequence[Mapping[str, Any]], Array, Sequence[int]], str]] = {
    "control.gains.alpha": _alpha,
    "sampling_period": _period,
    "control.gains.M_bar": _inertia,
}


def _judged(points: Sequence[Mapping[str, Any]]) -> str:
    """Run on which claim E2 is judged: Controller 2 if it was run."""
    runs = list(points[0]["runs"])
    return _SECOND if _SECOND in runs else str(runs[0])


def _ok(points: Sequence[Mapping[str, Any]], runs: Sequence[str]) -> list[int]:
    return [
        i
        for i, point in enumerate(points)
        if all(run in point["runs"] and point["runs"][run]["status"] == "ok" for run in runs)
    ]


def _of(point: Mapping[str, Any], run: str, name: str) -> Array:
    values = np.asarray(point["runs"][run][name], dtype=np.float64)
    return np.where(values > 0.0, values, np.nan)


def _slopes(
    points: Sequence[Mapping[str, Any]], run: str, x: Array, names: Sequence[str]
) -> dict[str, Array] | None:
    """Slopes of straight lines through the logarithms, per joint."""
    kept = _ok(points, (run,))
    if len(kept) < 2 or (x[kept] <= 0.0).any():
        return None
    log_x = np.log(x[kept])
    centred = log_x - log_x.mean(axis=0)
    return {
        name: (centred * np.log([_of(points[i], run, name) for i in kept])).sum(axis=0)
        / (centred**2).sum(axis=0)
        for name in names
    }


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{value:g}" for value in values) + "]"


def _plain(joints: Sequence[int], values: Array) -> str:
    return _each(joints, lambda k: f"{values[k]:.2f}")


def _each(joints: Sequence[int], words: Callable[[int], str]) -> str:
    """The same words once where they hold for all joints, else joint by joint."""
    said: Iterator[tuple[int, str]] = ((joint, words(k)) for k, joint in enumerate(joints))
    found = list(said)
    if len({text for _, text in found}) == 1:
        return found[0][1]
    return ", ".join(f"{text} (joint {joint})" for joint, text in found)
