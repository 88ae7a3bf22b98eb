"""Why the loops of a configuration behave as they do: margins, errors under loads, and what a change does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, get_args

import numpy as np

from tendonrepro.analysis.margins import (
    LOW_FREQUENCY,
    ChannelMargins,
    Cut,
    angle_grid,
    channel_margins,
    disk_margin,
)
from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import FILTERED, Readings
from tendonrepro.configuration.published import published
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import View, build_reference, run_views
from tendonrepro.files import Json
from tendonrepro.physics import control, linear_loop
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.summary import PAIRS
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result

_SLOWEST_HZ = 1e-3
"""Frequency from which the range of a ratio counts: what is slower is the ratio under a slow load."""
_OF_RUN = ("spectral_radius", "decay", "ringing_decay", "ringing_hz", "disk_margin")
_OF_JOINT = tuple(name for name in ChannelMargins._fields if name != "stable")
_NOT_SHOWN = {"ringing_decay", "gain_margin_hz", "crossover_hz", "delay_margin_s"}
"""Columns that the terminal has no room for."""


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

    `postures` (P, n), rad, are start, middle and far end of the reference. `modes` are by run, as `_modes`
    gives them, and `margins` too, one a joint. `ranges` are of the pairs whose loops decay, up to
    `ringing_hz`. `printed` has the paper's RMSE of the first run over the second's, by pair and joint, for
    its own arm. `changes` begins with the configuration as it is: for each the slowest ``decay`` by run,
    s⁻¹, and the ``ratio`` of slow errors by pair and joint.
    """

    joints: tuple[int, ...]
    postures: Array
    views: Mapping[str, View]
    modes: Mapping[str, Json]
    margins: Mapping[str, Sequence[ChannelMargins]]
    ranges: Mapping[str, RatioRange]
    printed: Mapping[str, list[float]]
    ringing_hz: float
    changes: Mapping[str, Json]
    origin: str


def explain(loaded: LoadedConfig) -> Explanation:
    """Linearise every run of a ``compare`` configuration."""
    config = loaded.config
    if not isinstance(config, CompareConfig):
        raise UsageError("only the experiment 'compare' has controllers to explain", where=loaded.origin)
    postures, views, ringing = _postures(loaded), run_views(config), config.status.ringing_frequency.si
    cuts = {
        run: [linear_loop.open_loop(q, view.plant, view.law, view.delay) for q in postures]
        for run, view in views.items()
    }
    ranges = {pair: ratio_range(a, b, postures, ringing) for pair, a, b in view_pairs(views)}
    return Explanation(
        joints=config.joints,
        postures=postures,
        views=views,
        modes={run: _modes(view, cuts[run], ringing) for run, view in views.items()},
        margins={
            run: [
                worst([channel_margins(cut, k, view.law.L) for cut in cuts[run]])
                for k in range(postures.shape[1])
            ]
            for run, view in views.items()
        },
        ranges={pair: of_pair for pair, of_pair in ranges.items() if of_pair},
        printed=_printed_ratios(config, views),
        ringing_hz=ringing,
        changes={
            name: {
                "decay": {run: _decay(view, postures) for run, view in changed.items()},
                "ratio": {pair: slow_ratio(a, b) for pair, a, b in view_pairs(changed)},
            }
            for name, changed in _changes(config, views)
        },
        origin=f"configuration {loaded.sha256[:12]}",
    )


def _postures(loaded: LoadedConfig) -> Array:
    """Start, middle and far end of the reference, rad, (3, n)."""
    config = loaded.config
    assert isinstance(config, CompareConfig)
    return linear_loop.stroke(build_reference(config.reference, config, loaded.folder).q_d)


def view_pairs(views: Mapping[str, View]) -> Iterator[tuple[str, View, View]]:
    """Neighbouring laws of the runs, as ``c1_c2`` and the first run of each."""
    first: dict[str, View] = {}
    for view in views.values():
        first.setdefault(view.law_name, view)
    for a, b in pairwise(first.values()):
        yield f"{a.law_name}_{b.law_name}".replace("controller_", "c"), a, b


def slow_ratio(a: View, b: View, size_deg: float = control.TYPICAL_ERROR_DEG) -> list[float]:
    """Ratio of two runs' errors of a size under a slow load, (n,)."""
    ratio: list[float] = control.error_ratio(a.law, b.law, float(np.deg2rad(size_deg)), a.delay).tolist()
    return ratio


def ratio_range(a: View, b: View, postures: Array, highest: float) -> RatioRange | None:
    """Range of the ratio of two runs' errors at postures (P, n) up to a frequency, Hz; None if a loop grows.

    Both meet the same loads and motions on the same arm, so ``E_a = G E_b`` with the responses ``G = T_a
    T_b⁻¹`` to any of them. The singular values of ``G`` bound the ratio of errors over all joints.
    """
    sizes, joints = [], []
    for q in postures:
        L = a.law.L
        angles = angle_grid(*(_closed(q, view) for view in (a, b)))
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


def _closed(q: Array, view: View) -> Array:
    return linear_loop.loop_matrix(q, view.plant, view.law, view.delay)


def load_to_error(view: View, q: Array, angles: Array) -> linear_loop.Complex | None:
    """Error of each joint per load on each, (F, n, n), at angles ``2 pi f L``; None if the loop grows.

    The load is held over a period. ``e = -q``.
    """
    n, law = q.size, view.law
    closed = _closed(q, view)
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
    paper, ratios = published(), {}
    for pair, *views_of in view_pairs(views):
        above, below = (
            np.array(paper.per_joint(f"table2.{view.law_name}.rmse", config.joints)) for view in views_of
        )
        if np.isfinite(above / below).all():
            ratios[pair] = (above / below).tolist()
    return ratios


def _modes(view: View, cuts: Sequence[Cut], ringing: float) -> Json:
    """Modes and disk margin of a run's loop, cut at several postures, the worst of these.

    ``decay``, s⁻¹, is of the slowest mode, negative where the loop grows; ``ringing_decay`` of the slowest
    one from `ringing`, Hz, on, or NaN.
    """
    L = view.law.L
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


def _changes(config: CompareConfig, views: Mapping[str, View]) -> Iterator[tuple[str, Mapping[str, View]]]:
    """Nothing, one more sample of delay, and every other reading, one at a time."""
    yield "as configured", views
    later = {name: view._replace(delay=view.delay + 1) for name, view in views.items()}
    yield f"output_delay={next(iter(later.values())).delay}", later
    for axis, field in Readings.model_fields.items():
        now = getattr(config.control.readings, axis)
        for value in get_args(field.annotation):
            # The history before the first sample is not part of a linear loop.
            if value == now or axis == "start":
                continue
            if value in FILTERED and config.control.filter_cutoff is None:
                continue
            readings = config.control.readings.model_copy(update={axis: value})
            control_of = config.control.model_copy(update={"readings": readings})
            yield f"{axis}={value}", run_views(config.model_copy(update={"control": control_of}))


def _decay(view: View, postures: Array) -> float:
    return linear_loop.decay_rate(list(postures), view.plant, view.law, view.delay)


def steadied_by(loaded: LoadedConfig) -> dict[str, float | None]:
    """Factor on each of two keys from which on all runs are stable.

    A smaller M_bar and more damping of the tendons steady most loops, a larger M_bar those where it is too
    small. Powers of two up to 128 are tried, and None says that none does.
    """
    config = loaded.config
    assert isinstance(config, CompareConfig)
    postures, views = _postures(loaded), run_views(config).values()

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


def explain_result(loaded: LoadedConfig) -> Result:
    """Explain a configuration."""
    from tendonrepro.analysis.figures import draw_margins

    try:
        explanation = explain(loaded)
    except ValueError as error:
        # NumPy's and SciPy's words for matrices that numbers cannot hold.
        message, hint = f"the loop cannot be linearised: {error}", "look at masses and stiffness"
        raise TendonreproError(message, where=loaded.origin, hint=hint) from error
    joints, views, margins = explanation.joints, explanation.views, explanation.margins
    middle, origin = explanation.postures[1], explanation.origin
    figures = {"explain_margins": lambda: draw_margins(joints, views, margins, middle, origin)}
    return Result(explanation_data(explanation), explanation_parts(explanation), figures)


def explanation_data(explanation: Explanation) -> dict[str, object]:
    """Plain numbers with the keys of ``--json``, some NaN."""
    modes, margins = explanation.modes, explanation.margins
    torque = {
        run: {name: [getattr(joint, name) for joint in joints] for name in _OF_JOINT}
        for run, joints in margins.items()
    }
    configured, *changes = explanation.changes.items()
    return {
        "schema_version": 2,
        "joints": list(explanation.joints),
        "postures_deg": np.rad2deg(explanation.postures).tolist(),
        "spectral_radius": {run: of_run["spectral_radius"] for run, of_run in modes.items()},
        "gain_margin": {run: of_run["gain_margin"] for run, of_run in torque.items()},
        "phase_margin": {run: of_run["phase_margin_deg"] for run, of_run in torque.items()},
        "loop_gain": {run: of_run["loop_gain"] for run, of_run in torque.items()},
        "loop_gain_frequency_hz": LOW_FREQUENCY,
        "predicted_ratio": dict.fromkeys(PAIRS) | configured[1]["ratio"],
        "predicted_ratio_error_deg": control.TYPICAL_ERROR_DEG,
        "predicted_ratio_holds": all(of_run["stable"] for of_run in modes.values()),
        "ratio_range": {
            pair: {
                "low": of_pair.of_joints[0].tolist(),
                "high": of_pair.of_joints[1].tolist(),
                "all_joints": of_pair.all_joints.tolist(),
            }
            for pair, of_pair in explanation.ranges.items()
        },
        "ratio_range_below_hz": explanation.ringing_hz,
        "printed_rmse_ratio": explanation.printed,
        "runs": {run: {**of_run, "torque": torque[run]} for run, of_run in modes.items()},
        "what_if": dict(changes),
    }


def explanation_parts(explanation: Explanation) -> list[Table | str]:
    """Margins of every run, ratios of slow errors, and what changes would do."""
    stability = (
        f"Stability of the sampled loop, worst of {len(explanation.postures)} postures "
        f"({explanation.origin}); margins with the other joints' loops closed, gain as a factor."
    )
    ratios = (
        f"Ratios of errors. Near {control.TYPICAL_ERROR_DEG:g} deg under slow loads no plant counts while "
        "loops are stable and well damped; least and largest are of small errors on this arm, without "
        f"friction, up to {explanation.ringing_hz:g} Hz. Ages in periods."
    )
    what_if = "What a change would do: slowest decay of each run, 1/s (negative: unstable), and slow errors"
    changes = [
        {"change": name, **what["decay"], **what["ratio"]} for name, what in explanation.changes.items()
    ]
    rows = [
        {"run": run, "joint": joint}
        | {name: modes[name] for name in _OF_RUN}
        | {name: getattr(of_joint, name) for name in _OF_JOINT}
        for run, modes in explanation.modes.items()
        for joint, of_joint in zip(explanation.joints, explanation.margins[run], strict=True)
    ]
    shown = [name for name in rows[0] if name not in _NOT_SHOWN]
    parts: list[Table | str] = [Table("explain", stability, rows, terminal=shown)]
    if unstable := [run for run, modes in explanation.modes.items() if not modes["stable"]]:
        parts.append(f"Unstable, so without margins or slow errors: {', '.join(unstable)}.")
    if slow := list(slow_rows(explanation)):
        parts.append(Table("slow_errors", ratios, slow))
    return [*parts, Table("changes", what_if, changes)]


def slow_rows(explanation: Explanation) -> Iterator[dict[str, object]]:
    """Yield neighbouring laws' ratio of errors on each joint, and its factors."""
    e = float(np.deg2rad(control.TYPICAL_ERROR_DEG))
    for pair, a, b in view_pairs(explanation.views):
        of_pair, printed = explanation.ranges.get(pair), explanation.printed.get(pair)
        ages = [control.estimate_age(view.law, view.delay) for view in (a, b)]
        softer = control.stiffness(b.law, e) / control.stiffness(a.law, e)
        for k, joint in enumerate(explanation.joints):
            yield {
                "laws": f"{a.law_name} / {b.law_name}",
                "joint": joint,
                "ratio": slow_ratio(a, b)[k],
                "least": float(of_pair.of_joints[0, k]) if of_pair else None,
                "largest": float(of_pair.of_joints[1, k]) if of_pair else None,
                "rmse_in_the_paper": printed[k] if printed else None,
                "age_of_the_first": float(ages[0][k]),
                "age_of_the_second": float(ages[1][k]),
                "surface_softer_by": float(softer[k]),
            }
