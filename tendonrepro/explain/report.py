"""What was found about the loops of a configuration, as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.console import columns
from tendonrepro.explain.analysis import PAIRS, Explanation, WhatIf, first_views, slow_ratio, view_pairs
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, estimate_age, stiffness


def explanation_text(found: Explanation) -> str:
    """Why the runs behave as they do: margins, slow errors, reserve and changes; every number is computed."""
    parts = [_margins(found), *_unstable(found), *_slow_errors(found), *_reserve(found), *_changes(found)]
    return "\n\n".join(parts)


def _margins(found: Explanation) -> str:
    rows = [["", "radius", "decay", "rings at", "disk"]]
    for joint in found.joints:
        rows[0] += [f"gain {joint}", f"phase {joint}"]
    rows[0] += [f"loop gain {joint}" for joint in found.joints]
    for run, m in found.margins.items():
        ringing = f"{_number_cell(m.ringing_frequency, '.1f')} Hz"
        row = [run, f"{m.spectral_radius:.6f}", f"{m.decay:.2f}/s", ringing, _number_cell(m.disk, ".2f")]
        for channel in m.channels:
            row.append(_number_cell(channel.gain_up, ".2f"))
            row.append(_number_cell(float(np.rad2deg(channel.phase)), ".1f"))
        rows.append([*row, *(f"{channel.loop_gain:.3g}" for channel in m.channels)])
    head = "Sampled loop, linearised; gain margin as a factor, phase in deg, the other joints' loops closed"
    return f"{head}\n{columns(rows)}"


def _number_cell(value: float, form: str) -> str:
    return "-" if np.isnan(value) else format(value, form)


def _joints_cell(values: Array, form: str = ".3f") -> str:
    return " | ".join(format(value, form) for value in values)


def _unstable(found: Explanation) -> Iterator[str]:
    lines = [
        f"{run} is unstable: a mode at {margin.frequency:.1f} Hz grows by the factor e in "
        f"{-1e3 / margin.decay:.3g} ms. It has no margin, and the ratios of slow errors do not apply to it."
        for run, margin in found.margins.items()
        if not margin.stable
    ]
    if lines:
        yield "\n".join(lines)


def _slow_errors(found: Explanation) -> Iterator[str]:
    """Ratio of neighbouring laws' errors, and its two factors: age of the estimate, slope of the surface."""
    e = float(np.deg2rad(TYPICAL_ERROR_DEG))
    rows = [["slow errors of", "ratio", "age of its estimate", "of the other's", "surface softer by"]]
    for pair, a, b in view_pairs(found.views):
        ages = [_joints_cell(estimate_age(view.law, view.delay)) for view in (a, b)]
        softer = _joints_cell(stiffness(b.law, e) / stiffness(a.law, e))
        ratio = _joints_cell(found.ratios[pair][TYPICAL_ERROR_DEG])
        rows.append([f"{a.law_name} / {b.law_name}", ratio, *ages, softer])
    if len(rows) == 1:
        return
    stable = all(margin.stable for margin in found.margins.values())
    head = "Prediction" if stable else "Were the loops stable"
    head += f": errors near {TYPICAL_ERROR_DEG:g} deg under slow loads, joint by joint; ages in periods.\n"
    head += "No plant enters while the loops are stable and quiet and dry friction does not hold the arm."
    views = first_views(found.views)
    against = next(iter(views.values()))
    sizes = {name: slow_ratio(view, against, TYPICAL_ERROR_DEG) for name, view in views.items()}
    ranked = [
        f"joint {joint}: {', '.join(sorted(sizes, key=lambda name: float(sizes[name][k])))}"
        for k, joint in enumerate(found.joints)
    ]
    yield f"{head}\n{columns(rows)}\nSmallest error first: {'; '.join(ranked)}."


def _reserve(found: Explanation) -> Iterator[str]:
    """How much more torque than commanded the weakest joint of each stable run bears."""
    rows = [["", "torque times", "at joint", "rings up at", "fast mode", "decays at"]]
    for run, margin in found.margins.items():
        if not margin.stable:
            continue
        k = int(np.argmin([np.nan_to_num(c.gain_up, nan=np.inf) for c in margin.channels]))
        up = margin.channels[k]
        cells = [
            _number_cell(up.gain_up, ".2f"),
            str(found.joints[k]),
            f"{_number_cell(up.gain_up_hz, '.1f')} Hz",
            f"{_number_cell(margin.ringing_frequency, '.3g')} Hz",
            f"{_number_cell(margin.ringing_decay, '.3g')}/s",
        ]
        rows.append([run, *cells])
    if len(rows) > 1:
        head = "Reserve of stability: how much larger than commanded a torque makes the weakest joint ring"
        yield f"{head}; slowest mode above slow motion\n{columns(rows)}"


def _changes(found: Explanation) -> Iterator[str]:
    pairs = [pair.replace("_", "/") if pair in PAIRS else pair for pair in found.ratios]
    rows = [["", *found.margins, *pairs]]
    now = WhatIf(
        {run: margin.decay for run, margin in found.margins.items()},
        {pair: sizes[TYPICAL_ERROR_DEG] for pair, sizes in found.ratios.items()},
    )
    for name, what in {"as configured": now, **found.what_if}.items():
        decays = [f"{value:.2f}" for value in what.decay.values()]
        rows.append([name, *decays, *(_joints_cell(ratio, ".2f") for ratio in what.ratios.values())])
    head = "What a change would do: slowest decay of each run, 1/s (negative: unstable); ratio of slow errors"
    yield f"{head}\n{columns(rows)}"
    lost = []
    for name, what in found.what_if.items():
        if runs := [run for run, value in what.decay.items() if value <= 0.0 and found.margins[run].stable]:
            lost.append(f"{name} ({', '.join(runs)})")
    if lost:
        yield f"Changes that make a run unstable which is stable now: {'; '.join(lost)}."
    if turned := [name for name, what in found.what_if.items() if _order_turned(now.ratios, what.ratios)]:
        yield f"Changes that turn the predicted order of neighbours: {', '.join(turned)}."


def _order_turned(now: Mapping[str, Array], then: Mapping[str, Array]) -> bool:
    return any(bool(np.any((now[pair] - 1.0) * (then[pair] - 1.0) < 0.0)) for pair in now)
