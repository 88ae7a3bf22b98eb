"""Why the loops of a configuration behave as they do: margins, errors under loads, and what a change does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypedDict, get_args

import numpy as np

from tendonrepro.analysis.margins import ChannelMargins, angle_grid, channel_margins, disk_margin
from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import FILTERED, Readings
from tendonrepro.configuration.published import published
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import View, build_reference, run_views
from tendonrepro.physics import linear_loop
from tendonrepro.physics.control import TYPICAL_ERROR_DEG, error_ratio
from tendonrepro.physics.linear_loop import Complex, loop_matrix
from tendonrepro.results.paper import is_arm_of_paper

_SLOWEST_HZ = 1e-3
"""Frequency from which the range of a ratio counts: what is slower is the ratio under a slow load."""


class RunModes(TypedDict):
    """What holds of all joints of a run together, the worst of several postures.

    ``decay``, s⁻¹, is of the slowest mode, negative where the loop grows; ``ringing_decay`` of the slowest
    fast one, or NaN.
    """

    law: str
    payload_kg: float
    output_delay: int
    spectral_radius: float
    stable: bool
    decay: float
    decay_hz: float
    ringing_decay: float
    ringing_hz: float
    disk_margin: float
    disk_margin_hz: float


class Change(TypedDict):
    """What one change makes of the slowest mode of each run, s⁻¹, and of each pair's ratios by joint."""

    decay: dict[str, float]
    ratio: dict[str, list[float]]


class RatioRange(NamedTuple):
    """Least and largest ratio of two runs' errors, (2, n), over loads or motions of one frequency.

    On a joint it is that of its own errors alone. ``all_joints`` (2,) bounds the ratio of the root mean
    squares over all joints, whatever load and motion both runs have.
    """

    of_joints: Array
    all_joints: Array


@dataclass(frozen=True)
class Explanation:
    """Everything that :func:`explain` finds.

    `postures` (P, n), rad, are start, middle and far end of the reference. `modes` and `margins` are by run,
    the latter one a joint. `ranges` are of the pairs whose loops decay, up to `ringing_hz`. `printed` has the
    paper's RMSE of the first run over the second's, by pair and joint, for its own arm. `changes` begins with
    the configuration as it is.
    """

    joints: tuple[int, ...]
    postures: Array
    views: Mapping[str, View]
    modes: Mapping[str, RunModes]
    margins: Mapping[str, Sequence[ChannelMargins]]
    ranges: Mapping[str, RatioRange]
    printed: Mapping[str, list[float]]
    ringing_hz: float
    changes: Mapping[str, Change]
    origin: str


def explain(loaded: LoadedConfig) -> Explanation:
    """Linearise every run of a ``compare`` configuration."""
    config = loaded.config
    if not isinstance(config, CompareConfig):
        raise UsageError("only the experiment 'compare' has controllers to explain", where=loaded.origin)
    postures = linear_loop.stroke(build_reference(config.reference, config, loaded.folder).q_d)
    views, ringing = run_views(config), config.status.ringing_frequency.si
    ranges = {pair: ratio_range(a, b, postures, ringing) for pair, a, b in view_pairs(views)}
    return Explanation(
        joints=config.joints,
        postures=postures,
        views=views,
        modes={run: run_modes(view, postures, ringing) for run, view in views.items()},
        margins={run: run_margins(view, postures) for run, view in views.items()},
        ranges={pair: of_pair for pair, of_pair in ranges.items() if of_pair},
        printed=_printed_ratios(config, views),
        ringing_hz=ringing,
        changes=dict(_changes(config, views, postures)),
        origin=f"configuration {loaded.sha256[:12]}",
    )


def view_pairs(views: Mapping[str, View]) -> Iterator[tuple[str, View, View]]:
    """Neighbouring laws of the runs, as ``c1_c2`` and the first run of each."""
    first: dict[str, View] = {}
    for view in views.values():
        first.setdefault(view.law_name, view)
    for a, b in pairwise(first.values()):
        yield f"{a.law_name}_{b.law_name}".replace("controller_", "c"), a, b


def slow_ratio(a: View, b: View, size_deg: float = TYPICAL_ERROR_DEG) -> list[float]:
    """Ratio of two runs' errors of a size under a slow load, (n,)."""
    ratio: list[float] = error_ratio(a.law, b.law, float(np.deg2rad(size_deg)), a.delay).tolist()
    return ratio


def ratio_range(a: View, b: View, postures: Array, highest: float) -> RatioRange | None:
    """Range of the ratio of two runs' errors at postures (P, n) up to a frequency, Hz; None if a loop grows.

    Both meet the same loads and motions on the same arm, so ``E_a = G E_b`` with the responses ``G = T_a
    T_b⁻¹`` to any of them. The singular values of ``G`` bound the ratio of errors over all joints.
    """
    sizes, joints = [], []
    for q in postures:
        L = a.law.L
        angles = angle_grid(*(loop_matrix(q, view.plant, view.law, view.delay) for view in (a, b)))
        hertz = angles / (2.0 * np.pi * L)
        angles = angles[(hertz >= _SLOWEST_HZ) & (hertz <= highest)]
        of_a, of_b = (load_to_error(view, q, angles) for view in (a, b))
        if of_a is None or of_b is None:
            return None
        G = of_a @ np.linalg.inv(of_b)
        sizes.append(np.linalg.svd(G, compute_uv=False))
        joints.append(np.abs(np.diagonal(G, axis1=1, axis2=2)))
    both = np.concatenate(joints), np.concatenate(sizes).reshape(-1)
    return RatioRange(*(np.stack([values.min(axis=0), values.max(axis=0)]) for values in both))


def load_to_error(view: View, q: Array, angles: Array) -> Complex | None:
    """Error of each joint per load on each, (F, n, n), at angles ``2 pi f L``; None if the loop grows.

    The load is held over a period. ``e = -q``.
    """
    n, law = q.size, view.law
    closed = loop_matrix(q, view.plant, law, view.delay)
    if np.abs(np.linalg.eigvals(closed)).max() >= 1.0:
        return None
    load = np.zeros((len(closed), n), dtype=np.complex128)
    load[: 4 * n] = linear_loop.load_matrix(q, view.plant, law.L)
    z = np.exp(1j * angles)[:, np.newaxis, np.newaxis]
    moved = np.linalg.solve(z * np.eye(len(closed)) - closed, load)
    return np.asarray(-moved[:, :n, :])


def _printed_ratios(config: CompareConfig, views: Mapping[str, View]) -> dict[str, list[float]]:
    """Ratio of two controllers' RMSE in Table 2, by pair and joint, where the arm is the paper's."""
    if not is_arm_of_paper(config.manipulator):
        return {}
    entries, ratios = published().entries, {}
    for pair, *of_pair in view_pairs(views):
        names = [[f"table2.{view.law_name}.rmse.joint_{k}" for k in config.joints] for view in of_pair]
        if entries.keys() >= {*names[0], *names[1]}:
            a, b = (np.array([published().number(name) for name in of_run]) for of_run in names)
            ratios[pair] = (a / b).tolist()
    return ratios


def run_modes(view: View, postures: Array, ringing: float) -> RunModes:
    """Modes and disk margin of a run at postures (P, n), rad; modes from `ringing`, Hz, on are fast."""
    L = view.law.L
    cuts = [linear_loop.open_loop(q, view.plant, view.law, view.delay) for q in postures]
    rates = [linear_loop.modes(A + B @ C, L) for A, B, C in cuts]
    growth, growth_hz = linear_loop.slowest(rates, 0.0)
    fast, fast_hz = linear_loop.slowest(rates, ringing)
    # NaN, of a posture where the loop grows, is the smallest of all.
    disk, disk_hz = min(
        (disk_margin(cut, L) for cut in cuts), key=lambda pair: np.nan_to_num(pair[0], nan=-1.0)
    )
    return {
        "law": view.law_name,
        "payload_kg": view.payload,
        "output_delay": view.delay,
        "spectral_radius": float(np.exp(growth * L)),
        "stable": growth < 0.0,
        "decay": -growth,
        "decay_hz": growth_hz,
        "ringing_decay": -fast,
        "ringing_hz": fast_hz,
        "disk_margin": disk,
        "disk_margin_hz": disk_hz,
    }


def run_margins(view: View, postures: Array) -> list[ChannelMargins]:
    """Margins of each joint of a run, the worst at postures (P, n), rad."""
    cuts = [linear_loop.open_loop(q, view.plant, view.law, view.delay) for q in postures]
    return [worst([channel_margins(cut, k, view.law.L) for cut in cuts]) for k in range(postures.shape[1])]


def worst(margins: Sequence[ChannelMargins]) -> ChannelMargins:
    """Smallest margin of several postures, number by number; none where one loop grows."""
    loop_gain = min(each.loop_gain for each in margins)
    if not all(each.stable for each in margins):
        return ChannelMargins(loop_gain=loop_gain)

    def least(name: str) -> ChannelMargins:
        return min(margins, key=lambda each: np.nan_to_num(getattr(each, name), nan=np.inf))

    gain = least("gain_margin")
    return least("phase_margin_deg")._replace(
        gain_margin=gain.gain_margin,
        gain_margin_hz=gain.gain_margin_hz,
        delay_margin_s=least("delay_margin_s").delay_margin_s,
        loop_gain=loop_gain,
    )


def _changes(
    config: CompareConfig, views: Mapping[str, View], postures: Array
) -> Iterator[tuple[str, Change]]:
    """Nothing, one more sample of delay, and every other reading, one at a time."""
    yield "as configured", _changed(views, postures)
    later = {name: view._replace(delay=view.delay + 1) for name, view in views.items()}
    yield f"output_delay={next(iter(later.values())).delay}", _changed(later, postures)
    for axis, field in Readings.model_fields.items():
        now = getattr(config.control.readings, axis)
        for value in get_args(field.annotation):
            # The history before the first sample is not part of a linear loop.
            if value == now or axis == "start":
                continue
            if value in FILTERED and config.control.filter_cutoff is None:
                continue
            readings = config.control.readings.model_copy(update={axis: value})
            control = config.control.model_copy(update={"readings": readings})
            changed = config.model_copy(update={"control": control})
            yield f"{axis}={value}", _changed(run_views(changed), postures)


def _changed(views: Mapping[str, View], postures: Array) -> Change:
    return {
        "decay": {run: _decay(view, postures) for run, view in views.items()},
        "ratio": {pair: slow_ratio(a, b) for pair, a, b in view_pairs(views)},
    }


def _decay(view: View, postures: Array) -> float:
    return linear_loop.decay_rate(list(postures), view.plant, view.law, view.delay)


def steadied_by(loaded: LoadedConfig) -> dict[str, float | None]:
    """Factor on each of two keys from which on all runs are stable.

    A smaller M_bar and more damping of the tendons steady most loops, a larger M_bar those where it is too
    small. Powers of two up to 128 are tried, and None says that none does.
    """
    config = loaded.config
    assert isinstance(config, CompareConfig)
    postures = linear_loop.stroke(build_reference(config.reference, config, loaded.folder).q_d)
    views = run_views(config).values()

    def first(changed: Callable[[View, float], View], factors: Sequence[float]) -> float | None:
        steady = (f for f in factors if all(_decay(changed(view, f), postures) > 0.0 for view in views))
        return next(steady, None)

    powers = [2.0**k for k in range(1, 8)]
    return {
        "control.gains.M_bar": first(_with_mass, [*(1.0 / power for power in powers), *powers]),
        "manipulator.tendons.damping_factor": first(_with_damping, powers),
    }


def _with_mass(view: View, factor: float) -> View:
    return view._replace(law=view.law._replace(M_bar=factor * view.law.M_bar))


def _with_damping(view: View, factor: float) -> View:
    drive = view.plant.drive
    return view._replace(plant=view.plant._replace(drive=drive._replace(damping=factor * drive.damping)))
