"""What was found about the loops of a configuration, in words made from the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.console import columns
from tendonrepro.explain.analysis import first_views, slow_ratio, view_pairs
from tendonrepro.explain.explanation import Explanation, View, WhatIf
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, estimate_age, stiffness

_NAMED_PAIRS = ("c1_c2", "c2_c3")
# Ratios nearer to 1 than this are called equal; slow loads of the real plant bend them by more.
_SAME = 0.005


def explanation_text(found: Explanation) -> str:
    """Why the runs behave as they do, in plain words.

    Parameters
    ----------
    found : Explanation

    Returns
    -------
    str
        A few paragraphs; every number in them is computed.
    """
    parts = [_table(found), *_unstable(found), *_errors(found), *_reserve(found), *_payload(found)]
    return "\n\n".join([*parts, *_changes(found)])


def _table(found: Explanation) -> str:
    rows = [["", "radius", "decay", "rings at", "disk"]]
    for joint in found.joints:
        rows[0] += [f"gain {joint}", f"phase {joint}"]
    rows[0] += [f"loop gain {joint}" for joint in found.joints]
    for run, m in found.margins.items():
        row = [
            run,
            f"{m.spectral_radius:.6f}",
            f"{m.decay:.2f}/s",
            f"{_number(m.ringing_frequency, '.1f')} Hz",
        ]
        row.append(_number(m.disk, ".2f"))
        for channel in m.channels:
            row += [_number(channel.gain_up, ".2f"), _number(float(np.rad2deg(channel.phase)), ".1f")]
        rows.append([*row, *(f"{channel.loop_gain:.3g}" for channel in m.channels)])
    head = "Sampled loop, linearised; gain margin as a factor, phase in deg, the other joints' loops closed"
    return f"{head}\n{columns(rows)}"


def _number(value: float, form: str) -> str:
    return "-" if np.isnan(value) else format(value, form)


def _unstable(found: Explanation) -> Iterator[str]:
    growing = {run: margin for run, margin in found.margins.items() if not margin.stable}
    if not growing:
        return
    lines = [
        f"{run} is unstable: a mode at {margin.frequency:.1f} Hz grows by the factor e in "
        f"{_milliseconds(-margin.decay)}. It has no margin, and the ratios of slow errors do not apply to it."
        for run, margin in growing.items()
    ]
    yield "\n".join(lines)


def _milliseconds(growth: float) -> str:
    return f"{1e3 / growth:.3g} ms"


def _errors(found: Explanation) -> Iterator[str]:
    e = float(np.deg2rad(TYPICAL_ERROR_DEG))
    stable = all(margin.stable for margin in found.margins.values())
    head = "Prediction: " if stable else "Were the loops stable: "
    for pair, a, b in view_pairs(found.views):
        ages = [estimate_age(view.law, view.delay) for view in (a, b)]
        soft = stiffness(b.law, e) / stiffness(a.law, e)
        ratio = _each(found.ratios[pair][TYPICAL_ERROR_DEG], found)
        reasons = _reasons(b.law_name, ages[0], ages[1], soft, found)
        yield f"{head}slow loads leave {a.law_name} with {ratio} times the error of {b.law_name}: {reasons}"
    views = first_views(found.views)
    if len(views) > 1:
        orders = [f"joint {joint}: {_order(views, k)}" for k, joint in enumerate(found.joints)]
        yield (
            f"{head}smallest error first, slow loads rank the laws (no plant enters, as long as the loops "
            f"are stable and quiet and dry friction does not hold the arm): {'; '.join(orders)}."
        )


def _each(values: Array, found: Explanation) -> str:
    numbers = [f"{value:.3f}" for value in values]
    if len(set(numbers)) == 1:
        return numbers[0]
    return ", ".join(f"{number} (joint {joint})" for number, joint in zip(numbers, found.joints, strict=True))


def _reasons(other: str, age: Array, its: Array, soft: Array, found: Explanation) -> str:
    """Name the factors that are not 1: age of the estimate against the other's, slope of the surface."""
    reasons = []
    if np.any(np.abs(age / its - 1.0) > _SAME):
        word = "older" if np.all(age >= its) else "fresher"
        reasons.append(
            f"its estimate of the load is {_each(age, found)} periods old on average when it acts, {word} "
            f"than that of {other}, {_each(its, found)}"
        )
    if np.any(np.abs(soft - 1.0) > _SAME):
        word = "softer" if np.all(soft >= 1.0) else "stiffer"
        reasons.append(
            f"at errors near {TYPICAL_ERROR_DEG:g} deg its surface is the {word} one, by {_each(soft, found)}"
        )
    return (
        "; and ".join(reasons or ["their estimates are equally old and their surfaces equally stiff"]) + "."
    )


def _order(views: Mapping[str, View], joint: int) -> str:
    against = next(iter(views.values()))
    sizes = {name: float(slow_ratio(view, against, TYPICAL_ERROR_DEG)[joint]) for name, view in views.items()}
    return ", ".join(sorted(sizes, key=sizes.__getitem__))


def _reserve(found: Explanation) -> Iterator[str]:
    stable = {run: margin for run, margin in found.margins.items() if margin.stable}
    if not stable:
        return
    lines = []
    for run, margin in stable.items():
        k = int(np.argmin([_infinite(c.gain_up) for c in margin.channels]))
        up = margin.channels[k]
        if np.isnan(up.gain_up):
            text = f"{run}: no larger torque than commanded makes it unstable"
        else:
            where = f"joint {found.joints[k]} makes it ring up at {up.gain_up_hz:.1f} Hz"
            text = f"{run}: {up.gain_up:.2f} times the commanded torque at {where}"
        recalled = min(margin.recalled, key=lambda c: _infinite(c.gain_up))
        if not np.isnan(recalled.gain_up):
            text += (
                f"; if the law remembers the larger torque, {_percent(recalled.gain_up)} more is enough, at "
                f"{recalled.gain_up_hz:.3g} Hz"
            )
        mode = f"; its slowest mode above slow motion, {margin.ringing_frequency:.3g} Hz, decays at "
        lines.append(text + (f"{mode}{margin.ringing_decay:.3g}/s." if margin.ringing_decay > 0.0 else "."))
    if len(stable) > 1:
        best = max(stable, key=lambda run: stable[run].disk)
        least = min(stable, key=lambda run: stable[run].disk)
        lines.append(
            f"Against errors in all joints' torques at once {best} has the largest margin (disk "
            f"{stable[best].disk:.3f}), {least} the smallest ({stable[least].disk:.3f})."
        )
    yield "Reserve of stability:\n" + "\n".join(lines)


def _infinite(value: float) -> float:
    return np.inf if np.isnan(value) else value


def _percent(factor: float) -> str:
    return f"{100.0 * (factor - 1.0):.2g} %"


def _payload(found: Explanation) -> Iterator[str]:
    """Compare runs that differ in nothing but what they carry."""
    first: dict[str, str] = {}
    for run, view in found.views.items():
        other = first.setdefault(view.law_name, run)
        if other == run or found.views[other].payload == view.payload:
            continue
        before, after = found.margins[other], found.margins[run]
        if not (found.margins[other].stable and found.margins[run].stable):
            continue
        change = view.payload - found.views[other].payload
        smallest = [min(_infinite(c.gain_up) for c in m.channels) for m in (before, after)]
        text = f"{change:+g} kg ({run} instead of {other}) leaves the age of the estimate as it is"
        text += ", so slow errors change only as the load's own rate does"
        text += f"; the slowest decay goes from {before.decay:.2f}/s to {after.decay:.2f}/s"
        if all(np.isfinite(smallest)):
            text += f", the gain margin from {smallest[0]:.2f} to {smallest[1]:.2f}"
        yield text + "."


def _changes(found: Explanation) -> Iterator[str]:
    rows = [["", *found.margins, *(_shown(pair) for pair in found.ratios)]]
    now = WhatIf(
        {run: margin.decay for run, margin in found.margins.items()},
        {pair: sizes[TYPICAL_ERROR_DEG] for pair, sizes in found.ratios.items()},
    )
    for name, what in {"as configured": now, **found.what_if}.items():
        decays = [f"{value:.2f}" for value in what.decay.values()]
        rows.append([name, *decays, *(_slashed(ratio) for ratio in what.ratios.values())])
    head = "What a change would do: slowest decay of each run, 1/s (negative: unstable); ratio of slow errors"
    yield f"{head}\n{columns(rows)}"
    lost = _breaking(found)
    if lost:
        yield "Changes that make a run unstable which is stable now: " + "; ".join(lost) + "."
    turned = [name for name, what in found.what_if.items() if _turned(now.ratios, what.ratios)]
    if turned:
        yield "Changes that turn the predicted order of neighbours: " + ", ".join(turned) + "."


def _breaking(found: Explanation) -> list[str]:
    lost = []
    for name, what in found.what_if.items():
        runs = [run for run, value in what.decay.items() if value <= 0.0 and found.margins[run].stable]
        if runs:
            lost.append(f"{name} ({', '.join(runs)})")
    return lost


def _turned(now: Any, then: Any) -> bool:
    return any(bool(np.any((now[pair] - 1.0) * (then[pair] - 1.0) < 0.0)) for pair in now)


def _shown(pair: str) -> str:
    return pair.replace("_", "/") if pair in _NAMED_PAIRS else pair


def _slashed(values: Array) -> str:
    return " | ".join(f"{value:.2f}" for value in values)
