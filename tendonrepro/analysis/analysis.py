"""Why the loops of a configuration behave as they do: margins, modes, predicted ratios of errors, maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import get_args

import numpy as np

from tendonrepro.analysis.maps import PARAMETERS, border_distance, gain_decay, root_locus, tendon_decay
from tendonrepro.analysis.margins import (
    ChannelMargins,
    angle_grid,
    channel,
    channel_margins,
    disk_margin,
    response,
)
from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import FILTERED, Readings
from tendonrepro.errors import UsageError
from tendonrepro.experiments.linear import View, run_views
from tendonrepro.experiments.loops import build_reference
from tendonrepro.physics.linear_loop import (
    Complex,
    decay_rate,
    loop_matrix,
    modes,
    open_loop,
    slowest,
    stroke,
)
from tendonrepro.physics.slow_error import ERROR_SIZES_DEG, TYPICAL_ERROR_DEG, error_ratio


@dataclass(frozen=True)
class RunMargins:
    """Stability of one run, the worst of the postures for every number.

    The slowest mode decays by `decay`, s⁻¹, negative where the loop grows, at a `frequency`, Hz; `ringing_`
    is the same of the slowest mode above the frequency from which on errors count as ringing, NaN without.
    Channels, one a joint, are for a torque that the law does not know; `disk` is the symmetric disk margin
    of all joints at once, at a Hz.
    """

    spectral_radius: float
    decay: float
    frequency: float
    ringing_decay: float
    ringing_frequency: float
    channels: tuple[ChannelMargins, ...]
    disk: float
    disk_hz: float

    @property
    def stable(self) -> bool:
        """Whether every mode decays at every posture."""
        return self.spectral_radius < 1.0


@dataclass(frozen=True)
class Curves:
    """Response of every joint's channel at the middle posture: Hz, and complex (joints, frequencies)."""

    hertz: Array
    channels: Complex


@dataclass(frozen=True)
class Map:
    """Borders of stability over factors (X,) and (Y,) on two parameters, `x` and `y`.

    By run the signed distance (Y, X) from its border, zero on it and positive where it is stable.
    """

    x: str
    y: str
    x_factors: Array
    y_factors: Array
    distance: Mapping[str, Array]


@dataclass(frozen=True)
class WhatIf:
    """One change: slowest decay per run, s⁻¹, and ratios of errors by pair, per joint."""

    decay: Mapping[str, float]
    ratios: Mapping[str, Array]


@dataclass(frozen=True)
class Explanation:
    """Everything that :func:`explain` finds; margins, curves and views by run.

    `postures` (P, n), rad, are start, middle and far end of the reference. `ratios` are by pair such as
    ``c1_c2``, size of the error in degrees, and joint; `what_if` by change such as
    ``weights=extrapolating``; `loci` by parameter and law: modes (factors, modes), s⁻¹ and rad s⁻¹, at the
    middle posture. `origin` marks the configuration in captions.
    """

    joints: tuple[int, ...]
    postures: Array
    views: Mapping[str, View]
    margins: Mapping[str, RunMargins]
    curves: Mapping[str, Curves]
    ratios: Mapping[str, Mapping[float, Array]]
    what_if: Mapping[str, WhatIf]
    loci: Mapping[str, Mapping[str, Complex]]
    locus_factors: Mapping[str, Array]
    maps: tuple[Map, ...]
    origin: str


PAIRS = ("c1_c2", "c2_c3")
"""Pairs of the paper's laws, of which ``--json`` always has the ratios."""
MAP_POINTS = 25
LOCUS_POINTS = 41


def explain(loaded: LoadedConfig) -> Explanation:
    """Linearise every run of a ``compare`` configuration: how stable it is, what its error must be."""
    config = loaded.config
    if not isinstance(config, CompareConfig):
        raise UsageError("only the experiment 'compare' has controllers to explain", where=loaded.origin)
    reference = build_reference(config.reference, config, loaded.folder)
    postures = stroke(reference.q_d)
    views = run_views(config)
    ringing = config.status.ringing_frequency.si
    factors = _locus_factors(views)
    return Explanation(
        joints=config.joints,
        postures=postures,
        views=views,
        margins={name: run_margins(view, postures, ringing) for name, view in views.items()},
        curves={name: _curves(view, postures[1]) for name, view in views.items()},
        ratios={
            pair: {size: slow_ratio(a, b, size) for size in ERROR_SIZES_DEG}
            for pair, a, b in view_pairs(views)
        },
        what_if=dict(_what_ifs(config, views, postures)),
        loci={
            parameter: {
                law: root_locus(postures[1], view.plant, view.law, view.delay, parameter, factors[parameter])
                for law, view in first_views(views).items()
            }
            for parameter in PARAMETERS
        },
        locus_factors=factors,
        maps=_maps(views, postures),
        origin=f"configuration {loaded.sha256[:12]}",
    )


def short(law_name: str) -> str:
    """``c1`` for ``controller_1``; other names stay."""
    return law_name.replace("controller_", "c")


def first_views(views: Mapping[str, View]) -> dict[str, View]:
    """First run of every law, by the law's name."""
    found: dict[str, View] = {}
    for view in views.values():
        found.setdefault(view.law_name, view)
    return found


def view_pairs(views: Mapping[str, View]) -> Iterator[tuple[str, View, View]]:
    """Neighbouring laws of the runs, as ``c1_c2`` and a run of each."""
    for a, b in pairwise(first_views(views).values()):
        yield f"{short(a.law_name)}_{short(b.law_name)}", a, b


def slow_ratio(a: View, b: View, size_deg: float) -> Array:
    """Ratio of two runs' errors under a slow load, (n,), by `tendonrepro.physics.slow_error.error_ratio`."""
    return error_ratio(a.law, b.law, float(np.deg2rad(size_deg)), a.delay)


def run_margins(view: View, postures: Array, ringing: float) -> RunMargins:
    """Stability of one run over postures (P, n), rad; from `ringing`, Hz, on a mode counts as ringing."""
    L, joints = view.law.L, range(postures.shape[1])
    found = [modes(loop_matrix(q, view.plant, view.law, view.delay), L) for q in postures]
    slow, fast = slowest(found, 0.0), slowest(found, ringing)

    cuts = [open_loop(q, view.plant, view.law, view.delay) for q in postures]
    channels = tuple(worst([channel_margins(cut, joint, L) for cut in cuts]) for joint in joints)
    disks = [disk_margin(cut, L) for cut in cuts]
    # NaN, of a posture where the loop grows, is the smallest of all.
    disk = min(disks, key=lambda pair: -1.0 if np.isnan(pair[0]) else pair[0])
    radius = float(np.exp(slow[0] * L))
    return RunMargins(radius, -slow[0], slow[1], -fast[0], fast[1], channels, *disk)


def worst(found: Sequence[ChannelMargins]) -> ChannelMargins:
    """Smallest margin of several postures, number by number; none where the loop grows at one of them."""
    gain = min(each.loop_gain for each in found)
    if not all(each.stable for each in found):
        return ChannelMargins(False, *7 * (np.nan,), gain)

    def least(key: Callable[[ChannelMargins], float]) -> ChannelMargins:
        return min(found, key=lambda each: np.inf if np.isnan(key(each)) else key(each))

    up, phase = least(lambda each: each.gain_up), least(lambda each: each.phase)
    down = least(lambda each: -each.gain_down)
    return ChannelMargins(
        stable=True,
        gain_up=up.gain_up,
        gain_up_hz=up.gain_up_hz,
        gain_down=down.gain_down,
        gain_down_hz=down.gain_down_hz,
        phase=phase.phase,
        crossover_hz=phase.crossover_hz,
        delay=least(lambda each: each.delay).delay,
        loop_gain=gain,
    )


def _curves(view: View, q: Array) -> Curves:
    cut = open_loop(q, view.plant, view.law, view.delay)
    A, B, C = cut
    angles = angle_grid(A + B @ C)
    hertz = angles / (2.0 * np.pi * view.law.L)
    shown = hertz >= 0.02
    channels = [response(channel(cut, joint), angles[shown])[:, 0, 0] for joint in range(q.size)]
    return Curves(hertz[shown], np.stack(channels))


def _what_ifs(
    config: CompareConfig, views: Mapping[str, View], postures: Array
) -> Iterator[tuple[str, WhatIf]]:
    """One more sample of delay, and every other reading of the paper's text, one at a time."""
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


def _changed(views: Mapping[str, View], postures: Array) -> WhatIf:
    return WhatIf(
        {name: decay_rate(list(postures), view.plant, view.law, view.delay) for name, view in views.items()},
        {pair: slow_ratio(a, b, TYPICAL_ERROR_DEG) for pair, a, b in view_pairs(views)},
    )


def _largest_alpha(views: Mapping[str, View]) -> float:
    """Factor up to which every weight of Eq. (15) stays at most 1, and 4 at most."""
    largest = max(float(np.abs(view.law.weights[1]).max()) for view in views.values())
    return min(4.0, 1.0 / largest) if largest > 0.0 else 4.0


def _locus_factors(views: Mapping[str, View]) -> dict[str, Array]:
    wide = np.geomspace(0.25, 4.0, LOCUS_POINTS)
    return dict.fromkeys(PARAMETERS, wide) | {"alpha": np.linspace(0.0, _largest_alpha(views), LOCUS_POINTS)}


def _maps(views: Mapping[str, View], postures: Array) -> tuple[Map, ...]:
    tendons, gains = np.geomspace(0.1, 10.0, MAP_POINTS), np.geomspace(0.1, 20.0, MAP_POINTS)
    alpha = np.linspace(0.0, _largest_alpha(views), MAP_POINTS)

    def over_tendons(view: View) -> Array:
        decay = partial(tendon_decay, list(postures), view.plant, view.law, view.delay)
        return border_distance(decay, tendons, tendons)

    def over_gains(view: View) -> Array:
        # The border runs along α, so it is looked for along M_bar.
        def decay(a: Array, m: Array) -> Array:
            return gain_decay(list(postures), view.plant, view.law, view.delay, m, a)

        return border_distance(decay, alpha, gains).T

    return (
        Map("K_s", "D_s", tendons, tendons, {run: over_tendons(view) for run, view in views.items()}),
        Map("M_bar", "alpha", gains, alpha, {run: over_gains(view) for run, view in views.items()}),
    )
