"""The box of plausible plants: draws from its unit cube, a search in it, and configurations of points."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array, Numeric
from tendonrepro.configuration.ensemble import FAST_PERIOD, EnsembleConfig
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.box import WORDS, BoxRange, BoxRow, Words
from tendonrepro.configuration.models.readings import AXES, UNDER_READINGS, as_printed
from tendonrepro.configuration.published import COMPARED
from tendonrepro.configuration.quantity import UNITS, Value, to_si
from tendonrepro.configuration.strict_yaml import Node, Section
from tendonrepro.monte_carlo.around import sobol
from tendonrepro.physics.trajectory import trapezoid_times

GRID = 0.01
"""Times of a motion are multiples of this, s, so that every sampling period divides them."""

_NOISE_BAND = (0.5, 20.0)
"""Band of the disturbance ``noise``, Hz."""

_NOISE_SINES = 8
"""Number of sines that make it."""

UNEQUAL = 2.0 / 3.0
"""Amplitude of joint 2 over that of joint 3 in the motion ``unequal``."""


if TYPE_CHECKING:
    from cma import CMAEvolutionStrategy

Draw: TypeAlias = Mapping[str, Numeric]
"""A value of every row of the box, SI, or those of many draws."""


@dataclass(frozen=True)
class Box:
    """The unknowns, (P,); SI units and radians.

    A word counts as its place in `words`, from 0; `scale` is ``linear``, ``log`` or ``choice``. Rows that
    are not `free` keep `nominal`. Motions are repeated until they last `shortest_run`, s.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Array
    nominal: Array
    high: Array
    scale: tuple[str, ...]
    confidence: tuple[str, ...]
    choices: tuple[Array, ...]
    words: tuple[tuple[str, ...], ...]
    free: NDArray[np.bool_]
    shortest_run: float

    def values(self, unit: Array) -> Array:
        """Map points of the unit cube to values, both (N, P); choices take equal slices."""
        return np.stack([self._column(i, unit[:, i]) for i in range(len(self.names))], axis=1)

    def _column(self, i: int, unit: Array) -> Array:
        if not self.free[i]:
            return np.full_like(unit, self.nominal[i])
        if self.choices[i].size:
            place = np.minimum(unit * self.choices[i].size, self.choices[i].size - 1.0).astype(int)
            return np.asarray(self.choices[i][place])
        low, high = self.low[i], self.high[i]
        value = low * (high / low) ** unit if self.scale[i] == "log" else low + (high - low) * unit
        return np.asarray(np.clip(value, low, high), dtype=np.float64)

    def sample(self, seed: int, replicate: int, first: int, count: int) -> Array:
        """Draws (count, P) of one scrambling from number `first` on; see `scrambled_sobol`."""
        return self.values(scrambled_sobol(self, seed, replicate, first, count))

    def only(self, confidences: Collection[str]) -> Box:
        """Box in which only rows of these confidences vary."""
        return replace(self, free=self.free & [confidence in confidences for confidence in self.confidence])

    def named(self, values: Array) -> dict[str, float]:
        """One draw (P,) by row name."""
        return dict(zip(self.names, values.tolist(), strict=True))


def make_box(config: EnsembleConfig) -> Box:
    """Box of a configuration, all rows free."""
    items = dict(config.box)
    numbers = [_si_numbers(name, row) for name, row in items.items()]
    low, nominal, high, choices = zip(*numbers, strict=True)
    return Box(
        names=tuple(items),
        units=tuple("1" if isinstance(row, Words) else UNITS[row.unit].si for row in items.values()),
        low=np.array(low),
        nominal=np.array(nominal),
        high=np.array(high),
        scale=tuple(row.scale if isinstance(row, BoxRange) else "choice" for row in items.values()),
        confidence=tuple(row.confidence for row in items.values()),
        choices=choices,
        words=tuple(WORDS.get(name, ()) for name in items),
        free=np.ones(len(items), dtype=np.bool_),
        shortest_run=config.shortest_run.si,
    )


def _si_numbers(name: str, row: BoxRow) -> tuple[float, float, float, Array]:
    """Low, nominal, high and choices of a row in SI; a word counts as its place."""
    if isinstance(row, BoxRange):
        low, nominal, high = (to_si(value, row.unit) for value in (row.low, row.nominal, row.high))
        return low, nominal, high, np.zeros(0)
    if isinstance(row, Words):
        nominal, *choices = (float(WORDS[name].index(word)) for word in (row.nominal, *row.choices))
    else:
        nominal, *choices = (to_si(value, row.unit) for value in (row.nominal, *row.choices))
    return min(choices), nominal, max(choices), np.array(choices)


def scrambled_sobol(box: Box, seed: int, replicate: int, first: int, count: int) -> Array:
    """Points (count, P) of a scrambled Sobol sequence in the unit cube, from number `first` on, from 0.

    Each depends on its number, seed and replicate alone. Rows that act under some readings alone are
    scrambled after the others, and so do not move them.
    """
    rows = len(box.names) - len(UNDER_READINGS)
    always = sobol(rows, [seed, replicate], first, count)
    under_readings = sobol(len(box.names), [seed, replicate, 1], first, count)[:, rows:]
    return np.concatenate([always, under_readings], axis=1)


def evolution(
    start: Array, width: float, population: int, generator: np.random.Generator
) -> CMAEvolutionStrategy:
    """CMA-ES in the unit cube, from a point (P,) with a first standard deviation.

    Its random numbers are its own.
    """
    import cma

    options = {
        "bounds": [0.0, 1.0],
        "popsize": population,
        "randn": lambda *shape: generator.standard_normal(shape),
        "seed": np.nan,  # else it would seed a generator that all of NumPy shares
        "verbose": -9,
    }
    return cma.CMAEvolutionStrategy(start, width, options)


def configured(base: LoadedConfig, box: Box, values: Array) -> CompareConfig:
    """Validated configuration of one draw (P,), every axis of readings as printed."""
    tree = _drawn_tree(base.tree, box.named(values), box.shortest_run)
    return as_printed(CompareConfig.model_validate(tree))


def _drawn_tree(base: Mapping[str, Node], draw: Mapping[str, float], shortest_run: float) -> Section:
    """Plain values of a comparison's configuration, from a value of every row of the box, SI.

    Periods are repeated, at least twice, until the motion lasts `shortest_run`, s.
    """
    tree: Section = deepcopy(dict(base))
    put_manipulator(tree["manipulator"], draw)
    # Links 2 and 3 start in line with link 1: the workspace of the box rests on it.
    tree["posture"] = _drawn([draw["posture"], 0.0, 0.0], "rad", "posture")
    tree["control"]["filter_cutoff"] = _drawn(draw["filter_cutoff"], "Hz", "filter_cutoff")
    tree["control"]["reference_lag"] = _drawn(draw["reference_lag"], "s", "reference_lag")
    tree["reference"] = drawn_reference(draw, shortest_run)
    tree["disturbance"] = drawn_disturbance(draw)
    tree["seed"] = _drawn(noise_seed(draw), "1", "its checksum, so that each has its own noise")
    return tree


def noise_seed(draw: Mapping[str, float]) -> int:
    """Checksum of the rows that always act."""
    always = [value for name, value in draw.items() if name not in UNDER_READINGS]
    return zlib.crc32(np.array(always).tobytes())


def put_manipulator(arm: Section, draw: Draw) -> None:
    """Fill in a manipulator from one draw, or arrays of draws."""
    put_links(arm["links"], draw)
    _put_drive(arm, draw)
    _put_friction(arm["friction"], draw)
    _put_options(arm, draw)


def is_word(draw: Draw, row: str, *words: str) -> Numeric:
    """Whether a row of words has one of some words."""
    matches: Numeric = sum(draw[row] == WORDS[row].index(word) for word in words)
    return matches > 0


def _drawn(value: object, unit: str, row: str) -> Section:
    return {"value": value, "unit": unit, "source": f"assumed: draw from the box, {row}"}


def _per_joint(two: Numeric, three: Numeric, unit: str, row: str) -> Section:
    """Vector of the manipulator; joint 1 is held, so its entry does not matter."""
    return _drawn([two, two, three], unit, row)


def _alike(value: Numeric, unit: str, row: str) -> Section:
    return _per_joint(value, value, unit, row)


def put_links(links: Section, draw: Draw) -> None:
    """Fill in a manipulator's links from one draw, or arrays of draws."""
    length = draw["link_length_2"], draw["link_length_3"]
    mass = draw["link_mass_2"], draw["link_mass_3"]
    com = draw["link_com_2"] * length[0], draw["link_com_3"] * length[1]
    inertia = (
        draw["link_inertia_2"] * mass[0] * length[0] ** 2,
        draw["link_inertia_3"] * mass[1] * length[1] ** 2,
    )
    links["length"] = _per_joint(*length, "m", "link_length")
    links["mass"] = _per_joint(*mass, "kg", "link_mass")
    links["com"] = _per_joint(*com, "m", "link_com of the length")
    links["inertia"] = _per_joint(*inertia, "kg m2", "link_inertia of m l^2")


def _put_drive(arm: Section, draw: Draw) -> None:
    winches, tendons = arm["winches"], arm["tendons"]
    motor = winches["reduction"]["value"] ** 2 * (draw["rotor_inertia"] + draw["reducer_inertia"])
    winches["reflected_inertia"] = _alike(motor, "kg m2", "rotor_inertia and reducer_inertia")
    winches["drum_inertia"] = _alike(draw["drum_inertia"], "kg m2", "drum_inertia")
    winches["viscous"] = _alike(draw["winch_viscous"], "N m s rad-1", "winch_viscous")
    # Where tendons 2 and 3 pass their own joints.
    diameter = arm["routing"]["pulley_diameter"]
    two, three = (to_si(diameter["value"][i][i], diameter["unit"]) / 2.0 for i in (1, 2))
    stiffness = draw["tendon_stiffness_2"] / two**2, draw["tendon_stiffness_3"] / three**2
    damping = draw["tendon_damping_2"] / two**2, draw["tendon_damping_3"] / three**2
    tendons["axial_stiffness"] = _per_joint(*stiffness, "N m-1", "tendon_stiffness over the radius squared")
    tendons["axial_damping"] = _per_joint(*damping, "N s m-1", "tendon_damping over the radius squared")
    two, three = (
        draw["clearance"] * is_word(draw, "clearance_at", *at) for at in (("both",), ("both", "distal"))
    )
    tendons["clearance"] = _per_joint(two, three, "m", "clearance and clearance_at")
    tendons["damping_factor"] = _drawn(1.0, "1", "which has the damping itself")


def switched(draw: Mapping[str, Value], row: str) -> Value:
    """Value of a row that may be off."""
    return draw[f"{row}_acts"] * draw[row]


def _put_friction(friction: Section, draw: Draw) -> None:
    on = {side: is_word(draw, "friction_sides", side, "both") for side in ("link", "winch")}
    for side, acts in on.items():
        part = friction[side]
        stribeck = draw[f"{side}_stribeck_velocity"]
        part["coulomb"] = _alike(acts * draw[f"{side}_coulomb"], "N m", f"{side}_coulomb")
        part["static_ratio"] = _alike(draw[f"{side}_static_ratio"], "1", f"{side}_static_ratio")
        part["stribeck_velocity"] = _alike(stribeck, "rad s-1", f"{side}_stribeck_velocity")
        part["smoothing_velocity"] = _alike(stribeck / 2.0, "rad s-1", f"half of {side}_stribeck_velocity")
    friction["link"]["viscous"] = _alike(on["link"] * draw["link_viscous"], "N m s rad-1", "link_viscous")
    friction["per_pulley"] = _drawn(switched(draw, "pulley_loss"), "1", "pulley_loss")
    acts = draw["reducer_loss_acts"]
    efficiency = acts * draw["reducer_efficiency"] + (1.0 - acts)
    friction["reducer_efficiency"] = _drawn(efficiency, "1", "reducer_efficiency")


def _put_options(arm: Section, draw: Draw) -> None:
    arm["tensioner"]["force"] = _drawn(draw["tensioner_force"], "N", "tensioner_force")
    arm["tensioner"]["side"] = AXES["tensioner"].printed
    error = switched(draw, "transmission_error")
    arm["transmission_error"]["peak_to_peak"] = _drawn(error, "rad", "transmission_error")
    actuator = arm["actuator"]
    actuator["torque_limit"] = _alike(draw["torque_limit"], "N m", "torque_limit")
    for row in ("torque_resolution", "torque_noise"):
        actuator[row] = _drawn(switched(draw, row), "N m", row)


def drawn_disturbance(draw: Mapping[str, float]) -> Section:
    """Disturbance of one draw, as plain values."""
    kind = WORDS["disturbance"][int(draw["disturbance"])]
    torque = _drawn([draw["disturbance_torque"]] * len(COMPARED), "N m", "disturbance_torque")
    if kind == "sine":
        frequency = _drawn(draw["disturbance_frequency"], "Hz", "disturbance_frequency")
        return {"kind": kind, "torque": torque, "frequency": frequency}
    if kind == "noise":
        band = _drawn(list(_NOISE_BAND), "Hz", "disturbance, whose band is fixed")
        components = _drawn(_NOISE_SINES, "1", "disturbance, whose number of sines is fixed")
        return {"kind": kind, "torque": torque, "band": band, "components": components}
    return {"kind": kind}


def drawn_reference(draw: Mapping[str, float], shortest_run: float) -> Section:
    """Motion of both joints, by equal angles except in ``unequal``, as plain values."""
    kind = WORDS["motion"][int(draw["motion"])]
    shape, cycle = _shape(kind, draw)
    share = UNEQUAL if kind == "unequal" else 1.0
    size = 0.5 if shape["kind"] == "sine" else 1.0  # a sine swings about the middle of the same range
    amplitude = [size * share * draw["amplitude"], size * draw["amplitude"]]
    shape["amplitude"] = _drawn(amplitude, "rad", "amplitude")
    if shape["kind"] == "sine":
        shape["offset"] = _drawn(amplitude, "rad", "amplitude")
    periods = max(2.0, float(np.ceil(shortest_run / cycle)))
    return {**shape, "periods": _drawn(periods, "1", "as many as the shortest run asks for")}


def _shape(kind: str, draw: Mapping[str, float]) -> tuple[Section, float]:
    """Kind and times of a motion, and its period, s."""
    if kind in ("minimum_jerk", "ramp"):
        rise, hold = _on_grid(draw["rise"]), _on_grid(draw["hold"])
        times = {"rise": _drawn(rise, "s", "rise"), "hold": _drawn(hold, "s", "hold")}
        return {"kind": kind, **times}, 2.0 * (rise + hold)
    if kind == "trapezoidal":
        limits = draw["velocity"], draw["acceleration"]
        _, rise = trapezoid_times(draw["amplitude"], *limits)
        half = _on_grid(rise + draw["hold"] + GRID / 2.0)  # never shorter than the stroke
        return {
            "kind": kind,
            "velocity": _drawn(limits[0], "rad s-1", "velocity"),
            "acceleration": _drawn(limits[1], "rad s-2", "acceleration"),
            "hold": _drawn(half - rise, "s", "hold"),
        }, 2.0 * half
    period = FAST_PERIOD if kind == "fast_sine" else _on_grid(draw["period"])
    times = {"period": _drawn(period, "s", "period")}
    if kind in ("sine", "fast_sine"):
        blend = _drawn(period / 2.0, "s", "half the period")
        return {"kind": "sine", **times, "blend": blend}, period
    return {"kind": "raised_cosine", **times}, period


def _on_grid(time: float) -> float:
    return round(time / GRID) * GRID
