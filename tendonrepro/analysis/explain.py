"""Why the loops of a configuration behave as they do: margins, errors under loads, and what a change does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypedDict, get_args

import numpy as np

from tendonrepro.analysis.margins import (
    ChannelMargins,
    TendonMap,
    angle_grid,
    border_of_run,
    channel,
    channel_margins,
    disk_margin,
    response,
    tendon_factors,
    with_tendons,
)
from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import FILTERED, Readings
from tendonrepro.configuration.published import published
from tendonrepro.console import QUIET, Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import View, build_reference, run_views
from tendonrepro.parallel import Start, counted
from tendonrepro.physics.control import ERROR_SIZES_DEG, TYPICAL_ERROR_DEG, error_ratio
from tendonrepro.physics.linear_loop import (
    Complex,
    decay_rate,
    load_matrix,
    loop_matrix,
    modes,
    open_loop,
    plant_matrices,
    slowest,
    stroke,
)
from tendonrepro.results.paper import is_arm_of_paper

_LOWEST_HZ = 0.05
_SLOWEST_HZ = 1e-3
"""Frequency from which the range of a ratio counts: what is slower is the ratio under a slow load."""
_POINTS = 400
_MOTION_SHARE = 0.99
"""Share of the power of the desired velocity that lies within the motion's bandwidth."""


class RunModes(TypedDict):
    """What holds of all joints of a run together.

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
class RunMargins:
    """Stability of one run, the worst of several postures for every number."""

    of_run: RunModes
    joints: Sequence[ChannelMargins]


@dataclass(frozen=True)
class Loads:
    """Size of each joint's error per load on it, rad N⁻¹ m⁻¹, (n, F), of laws whose loops decay.

    `mode_hz` is the least damped mode of the arm without a controller, or NaN. Up to `motion_hz` the desired
    velocity has 99 % of its power.
    """

    hertz: Array
    error: Mapping[str, Array]
    mode_hz: float
    motion_hz: float


@dataclass(frozen=True)
class Explanation:
    """Everything that :func:`explain` finds.

    `postures` (P, n), rad, are start, middle and far end of the reference. A curve is Hz (F,) and every
    joint's channel (n, F) at the middle posture. `ratios` are by pair, size of the error, deg, and joint;
    `ranges` are of the pairs whose loops decay, up to `ringing_hz`. `printed` has the paper's RMSE of the
    first run over the second's, by pair and joint, for its own arm. `what_if` is by the change.
    """

    joints: tuple[int, ...]
    postures: Array
    views: Mapping[str, View]
    margins: Mapping[str, RunMargins]
    curves: Mapping[str, tuple[Array, Complex]]
    ratios: Mapping[str, Mapping[float, list[float]]]
    ranges: Mapping[str, RatioRange]
    printed: Mapping[str, list[float]]
    ringing_hz: float
    what_if: Mapping[str, Change]
    borders: TendonMap
    loads: Loads
    origin: str


def explain(loaded: LoadedConfig, talk: Talk = QUIET, start: Start = map) -> Explanation:
    """Linearise every run of a ``compare`` configuration; `start` works at several runs at once."""
    config = loaded.config
    if not isinstance(config, CompareConfig):
        raise UsageError("only the experiment 'compare' has controllers to explain", where=loaded.origin)
    reference = build_reference(config.reference, config, loaded.folder)
    postures = stroke(reference.q_d)
    views = run_views(config)
    ringing = config.status.ringing_frequency.si
    begun = start(partial(_run_found, postures=postures, ringing=ringing), list(views.values()))
    with talk.bar("linearising", len(views)) as progress:
        margins, distances = zip(*counted(begun, progress), strict=True)
    return Explanation(
        joints=config.joints,
        postures=postures,
        views=views,
        margins=dict(zip(views, margins, strict=True)),
        curves={run: _curve(view, postures[1]) for run, view in views.items()},
        ratios={
            pair: {size: slow_ratio(a, b, size) for size in ERROR_SIZES_DEG}
            for pair, a, b in view_pairs(views)
        },
        ranges=dict(_ranges(views, postures, ringing)),
        printed=_printed_ratios(config, views),
        ringing_hz=ringing,
        what_if=dict(_what_ifs(config, views, postures)),
        borders=TendonMap(tendon_factors(), dict(zip(views, distances, strict=True))),
        loads=loads(first_views(views), postures[1], reference.dq_d),
        origin=f"configuration {loaded.sha256[:12]}",
    )


def _run_found(view: View, postures: Array, ringing: float) -> tuple[RunMargins, Array]:
    """Margins of one run, and how far it is from the border of stability on the map of tendons."""
    return run_margins(view, postures, ringing), border_of_run(view, postures, tendon_factors())


def first_views(views: Mapping[str, View]) -> dict[str, View]:
    """First run of every law, by the law's name."""
    found: dict[str, View] = {}
    for view in views.values():
        found.setdefault(view.law_name, view)
    return found


def view_pairs(views: Mapping[str, View]) -> Iterator[tuple[str, View, View]]:
    """Neighbouring laws of the runs, as ``c1_c2`` and a run of each."""
    for a, b in pairwise(first_views(views).values()):
        yield f"{a.law_name}_{b.law_name}".replace("controller_", "c"), a, b


def slow_ratio(a: View, b: View, size_deg: float) -> list[float]:
    """Ratio of two runs' errors under a slow load, (n,)."""
    ratio: list[float] = error_ratio(a.law, b.law, float(np.deg2rad(size_deg)), a.delay).tolist()
    return ratio


def _ranges(views: Mapping[str, View], postures: Array, ringing: float) -> Iterator[tuple[str, RatioRange]]:
    for pair, a, b in view_pairs(views):
        if (of_pair := ratio_range(a, b, postures, ringing)) is not None:
            yield pair, of_pair


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


def _printed_ratios(config: CompareConfig, views: Mapping[str, View]) -> dict[str, list[float]]:
    """Ratio of two controllers' RMSE in Table 2, by pair and joint, where the arm is the paper's."""
    entries = published().entries
    ratios = {}
    for pair, *of_pair in view_pairs(views) if is_arm_of_paper(config.manipulator) else ():
        names = [
            [f"table2.{view.law_name}.rmse.joint_{joint}" for joint in config.joints] for view in of_pair
        ]
        if all(name in entries for of_run in names for name in of_run):
            a, b = (np.array([published().number(name) for name in of_run]) for of_run in names)
            ratios[pair] = (a / b).tolist()
    return ratios


def run_margins(view: View, postures: Array, ringing: float) -> RunMargins:
    """Stability of one run at postures (P, n), rad; modes from `ringing`, Hz, on are fast."""
    L = view.law.L
    of_postures = [modes(loop_matrix(q, view.plant, view.law, view.delay), L) for q in postures]
    (growth, growth_hz), (fast, fast_hz) = slowest(of_postures, 0.0), slowest(of_postures, ringing)
    cuts = [open_loop(q, view.plant, view.law, view.delay) for q in postures]
    # NaN, of a posture where the loop grows, is the smallest of all.
    disk, disk_hz = min(
        (disk_margin(cut, L) for cut in cuts), key=lambda pair: np.nan_to_num(pair[0], nan=-1.0)
    )
    of_run: RunModes = {
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
    return RunMargins(
        of_run, [worst([channel_margins(cut, k, L) for cut in cuts]) for k in range(view.law.M_bar.size)]
    )


def worst(margins: Sequence[ChannelMargins]) -> ChannelMargins:
    """Smallest margin of several postures, number by number; none where one loop grows."""
    gain = min(each.loop_gain for each in margins)
    if not all(each.stable for each in margins):
        return ChannelMargins(loop_gain=gain)

    def least(name: str, sign: float = 1.0) -> ChannelMargins:
        return min(margins, key=lambda each: np.nan_to_num(sign * getattr(each, name), nan=np.inf))

    up, down, delay = least("gain_margin"), least("gain_reduction_margin", -1.0), least("delay_margin_s")
    return least("phase_margin_deg")._replace(
        gain_margin=up.gain_margin,
        gain_margin_hz=up.gain_margin_hz,
        gain_reduction_margin=down.gain_reduction_margin,
        gain_reduction_margin_hz=down.gain_reduction_margin_hz,
        delay_margin_s=delay.delay_margin_s,
        loop_gain=gain,
    )


def _curve(view: View, q: Array) -> tuple[Array, Complex]:
    A, B, C = cut = open_loop(q, view.plant, view.law, view.delay)
    angles = angle_grid(A + B @ C)
    hertz = angles / (2.0 * np.pi * view.law.L)
    shown = hertz >= 0.02
    channels = [response(channel(cut, joint), angles[shown])[:, 0, 0] for joint in range(q.size)]
    return hertz[shown], np.stack(channels)


def loads(views: Mapping[str, View], q: Array, dq_d: Array) -> Loads:
    """Error per load at posture `q` (n,), rad, beside a motion's velocity (T, n), rad s⁻¹."""
    first = next(iter(views.values()))
    L = first.law.L
    hertz = np.geomspace(_LOWEST_HZ, 0.5 / L, _POINTS)
    responses = {law: load_to_error(view, q, 2.0 * np.pi * L * hertz) for law, view in views.items()}
    return Loads(
        hertz,
        {
            law: np.abs(np.diagonal(values, axis1=1, axis2=2).T)
            for law, values in responses.items()
            if values is not None
        },
        _least_damped(plant_matrices(q, first.plant)[0]),
        _bandwidth(dq_d, L),
    )


def load_to_error(view: View, q: Array, angles: Array) -> Complex | None:
    """Error of each joint per load on each, (F, n, n), at angles ``2 pi f L``; None if the loop grows.

    The load is held over a period. ``e = -q``.
    """
    n, law = q.size, view.law
    closed = loop_matrix(q, view.plant, law, view.delay)
    if np.abs(np.linalg.eigvals(closed)).max() >= 1.0:
        return None
    load = np.zeros((len(closed), n), dtype=np.complex128)
    load[: 4 * n] = load_matrix(q, view.plant, law.L)
    z = np.exp(1j * angles)[:, np.newaxis, np.newaxis]
    moved = np.linalg.solve(z * np.eye(len(closed)) - closed, load)
    return np.asarray(-moved[:, :n, :])


def _least_damped(A: Array) -> float:
    """Frequency of the least damped oscillation of dx/dt = A x, Hz."""
    rates = np.linalg.eigvals(A)
    rates = rates[rates.imag > 0.0]
    if not rates.size:
        return float("nan")
    return float(rates[np.argmin(-rates.real / np.abs(rates))].imag / (2.0 * np.pi))


def _bandwidth(dq_d: Array, L: float) -> float:
    power = (np.abs(np.fft.rfft(dq_d, axis=0)) ** 2).sum(axis=1)
    if not power.any():
        return 0.0
    share = np.cumsum(power) / power.sum()
    return float(np.fft.rfftfreq(len(dq_d), L)[np.searchsorted(share, _MOTION_SHARE)])


def _what_ifs(
    config: CompareConfig, views: Mapping[str, View], postures: Array
) -> Iterator[tuple[str, Change]]:
    """One more sample of delay, and every other reading, one at a time."""
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
        "decay": {
            run: decay_rate(list(postures), view.plant, view.law, view.delay) for run, view in views.items()
        },
        "ratio": {pair: slow_ratio(a, b, TYPICAL_ERROR_DEG) for pair, a, b in view_pairs(views)},
    }


def steadied_by(loaded: LoadedConfig) -> dict[str, float | None]:
    """Factor on each of two keys from which on all runs are stable.

    A smaller M_bar and more damping of the tendons steady most loops, a larger M_bar those where it is too
    small. Powers of two up to 128 are tried, and None says that none does.
    """
    config = loaded.config
    assert isinstance(config, CompareConfig)
    postures = list(stroke(build_reference(config.reference, config, loaded.folder).q_d))
    views = run_views(config).values()

    def first(changed: Callable[[View, float], View], factors: Sequence[float]) -> float | None:
        for factor in factors:
            now = [changed(view, factor) for view in views]
            if all(decay_rate(postures, view.plant, view.law, view.delay) > 0.0 for view in now):
                return factor
        return None

    powers = [2.0**k for k in range(1, 8)]
    return {
        "control.gains.M_bar": first(
            lambda view, factor: view._replace(law=view.law._replace(M_bar=factor * view.law.M_bar)),
            [*(1.0 / power for power in powers), *powers],
        ),
        "manipulator.tendons.damping_factor": first(
            lambda view, factor: view._replace(plant=with_tendons(view.plant, 1.0, factor)), powers
        ),
    }
