"""What an explanation of a configuration's loops consists of: plain frozen values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tendonrepro.arrays import Array
from tendonrepro.experiments.linear import View
from tendonrepro.explain.margins import ChannelMargins
from tendonrepro.physics.linear_loop import Complex


@dataclass(frozen=True)
class RunMargins:
    """Stability of one run, the worst of the postures for every number.

    Attributes
    ----------
    spectral_radius : float
    decay : float
        Slowest decay, s⁻¹; negative where the loop grows.
    frequency : float
        Frequency of that mode, Hz.
    ringing_decay, ringing_frequency : float
        The same of the slowest mode above the frequency from which on errors count as ringing; NaN without.
    channels : tuple of ChannelMargins
        One per joint, for a torque that the law does not know.
    disk, disk_hz : float
        Symmetric disk margin of all joints at once, and its frequency, Hz.
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
    """Borders of stability over factors on two parameters.

    Attributes
    ----------
    x, y : str
        Parameters.
    x_factors : array (X,)
    y_factors : array (Y,)
    distance : mapping
        Run -> signed distance (Y, X) from its border, zero on it and positive where it is stable.
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
    """Everything that :func:`explain` finds.

    Attributes
    ----------
    joints : tuple of int
    postures : array (P, n)
        Start, middle and far end of the reference, rad.
    views : mapping
        Run -> law, plant and delay.
    margins : mapping
        Run -> `RunMargins`.
    curves : mapping
        Run -> `Curves`.
    ratios : mapping
        Pair such as ``c1_c2`` -> error size in degrees -> ratio per joint.
    what_if : mapping
        Change such as ``weights=extrapolating`` -> `WhatIf`.
    loci : mapping
        Parameter -> law -> modes (factors, modes), s⁻¹ and rad s⁻¹, at the middle posture.
    locus_factors : mapping
        Parameter -> factors.
    maps : tuple of Map
        Tendons and gains.
    origin : str
        Mark of the configuration, for captions.
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
