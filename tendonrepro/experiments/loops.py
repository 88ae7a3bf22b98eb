"""From a configuration to closed loops: references, laws, and one loop per run."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, Config, LoadedConfig
from tendonrepro.configuration.models.control import RUNS, Gains, Readings
from tendonrepro.configuration.models.experiment import MOST_SAMPLES, errors_from
from tendonrepro.configuration.models.readings import Reading, under
from tendonrepro.configuration.models.reference import (
    InTurns,
    PerJoint,
    ReferenceConfig,
    Sampled,
    read_samples,
)
from tendonrepro.configuration.published import published
from tendonrepro.configuration.quantity import Value
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments import rig
from tendonrepro.experiments.user_law import UserLaw, lane_function, own_loops
from tendonrepro.physics import control, drive, dynamics, linear_loop, metrics, trajectory
from tendonrepro.results.records import RESERVED
from tendonrepro.simulation.loop import DesiredMotion, Loop, PositionController, Solver, TimeDelayController

RESOLVED_ANGLE = 1e-9
"""Error that counts as resolved with an ideal encoder, rad; see ``Law.power_floor``."""

Case: TypeAlias = tuple[str, Reading]
"""A run, under a reading."""

Part = TypeVar("Part")

PERIODS = {"one_period": 1, "two_periods": 2, "four_periods": 4}
"""Sampling periods of the delay time under each reading of it."""


def reference_period(reference: ReferenceConfig) -> float:
    """Duration after which a reference repeats, s; 0 if it does not, or if joints differ."""
    if isinstance(reference, Sampled):
        return 0.0
    singles = reference.references if isinstance(reference, PerJoint) else (reference,)
    periods = {single.duration / single.periods.si for single in singles}
    return periods.pop() if len(periods) == 1 else 0.0


def build_reference(
    reference: ReferenceConfig, config: Config, folder: Path, S: Array | None = None, key: str = "reference"
) -> DesiredMotion:
    """Desired motion at every sample.

    Paths of trajectory files start at `folder`. `S` (n, n) maps motors' angles to joints where a reference
    moves motors. A ConfigError names `key` where a link would leave the half-plane.
    """
    L = config.sampling_period.si
    followed = motions(reference, config.joints, folder)
    if not 1.0 <= followed[0].duration / L <= MOST_SAMPLES:
        message = f"lasts {followed[0].duration:g} s; a run has from 1 to {MOST_SAMPLES:g} periods of {L:g} s"
        raise ConfigError(message, where=key)
    time: Array = L * np.arange(int(np.floor(followed[0].duration / L + 1e-6)) + 1.0)
    q_d, dq_d, ddq_d = trajectory.motion(time, followed)
    if S is not None:
        q_d, dq_d, ddq_d = q_d @ S.T, dq_d @ S.T, ddq_d @ S.T
    built = DesiredMotion(time, q_d, dq_d, ddq_d, reference_period(reference))
    _check_workspace(built, config, key)
    return built


def motions(reference: ReferenceConfig, joints: Sequence[int], folder: Path) -> list[trajectory.Motion]:
    """What each joint follows; a trajectory file lies in `folder`."""
    if isinstance(reference, Sampled):
        return _sampled_motions(folder / reference.file, joints, reference.interpolation)
    if isinstance(reference, PerJoint):
        parts = zip(reference.references, joints, strict=True)
        return [motions(single, (joint,), folder)[0] for single, joint in parts]
    shapes = [reference.shape(i) for i in range(len(joints))]
    if not isinstance(reference, InTurns):
        return [trajectory.Motion((shape,), reference.duration) for shape in shapes]
    turns = (reference.turns or (tuple(joints),)) * int(reference.periods.si)
    return [
        trajectory.Motion(
            tuple(shape if joint in turn else trajectory.at_rest for turn in turns), reference.cycle
        )
        for shape, joint in zip(shapes, joints, strict=True)
    ]


def _sampled_motions(path: Path, joints: Sequence[int], interpolation: str) -> list[trajectory.Motion]:
    time, angles = read_samples(path, interpolation)
    through = {"quintic": trajectory.sampled, "linear": trajectory.straight_lines}[interpolation]
    for joint in joints:
        if joint not in angles:
            message = f"has no column for joint {joint}"
            raise ConfigError(message, where=str(path), hint=f"add a column q{joint}_deg")
        if start := np.rad2deg(angles[joint][0]):
            message = f"joint {joint} starts at {start:g} deg; it must start at 0, the start posture"
            raise ConfigError(message, where=f"{path}:2", hint="take the first angle off the whole column")
    return [trajectory.Motion((through(time, angles[joint]),), float(time[-1] - time[0])) for joint in joints]


def _check_workspace(reference: DesiredMotion, config: Config, key: str) -> None:
    """Links work between hanging and upright; elsewhere gravity would slacken the tendons."""
    angles = np.rad2deg(rig.start_angles(config) + np.cumsum(reference.q_d, axis=1))
    outside = np.argwhere((angles <= 0.0) | (angles >= 180.0))
    if outside.size:
        k, i = outside[0]
        words = f"{angles[k, i]:.1f} deg from hanging at t = {reference.time[k]:.3f} s"
        message = f"link {config.joints[i]} would reach {words}"
        hint = "links must stay between 0 and 180 deg: change posture or the reference's amplitude"
        raise ConfigError(message, where=key, hint=hint)


def build_law(config: CompareConfig, name: str) -> control.Law:
    """Gains and readings of one of ``control.laws``."""
    gains, readings, choice = config.control.gains, config.control.readings, config.control.laws[name]
    n, L = len(config.joints), config.sampling_period.si
    alpha_tde = choice.estimator == "alpha_tde"
    alpha = gains.alpha.si if alpha_tde else np.zeros(n)
    dropped = choice.surface == "ntsm" and not alpha_tde and readings.eta_in_controller_2 == "dropped"
    scale = 1.0 if readings.gain_unit == "radian" else control.DEGREES_PER_RADIAN
    mass_scale = control.DEGREES_PER_RADIAN if readings.gain_unit == "law_in_degrees" else 1.0
    cutoff = config.control.filter_cutoff
    # Weight of the newest value in a low-pass.
    low_pass = 1.0 if cutoff is None else 1.0 - np.exp(-2.0 * np.pi * cutoff.si * L)
    to_joint = torque_map(config)
    return control.Law(
        surface=int(control.Surface[choice.surface.upper()]),
        L=L,
        lag=PERIODS[readings.delay_time],
        M_bar=gains.M_bar.si * mass_scale,
        lam=gains.lam.si,
        eta=gains.eta.si,
        b=gains.b.si,
        Delta=_boundary(gains, readings),
        beta=gains.beta.si,
        K_d=gains.K_d.si if gains.K_d else np.zeros(n),
        K_p=gains.K_p.si if gains.K_p else np.zeros(n),
        weights=control.estimator_weights(alpha, readings.weights if alpha_tde else "interpolating"),
        newest=0 if readings.differencing == "centred" else 1,
        phi_is_odd=readings.phi_negative == "odd",
        power_inside=readings.phi_branch == "power",
        power_floor=power_floor(config.manipulator.encoders.joint.resolution.si, scale),
        angle_scale=scale,
        rate_gain=np.ones(n) if dropped else gains.eta.si,
        rate_filter=low_pass if readings.error_rate == "low_pass" else 1.0,
        ddq_filter=low_pass if readings.estimate_filter == "acceleration" else 1.0,
        estimate_filter=low_pass if readings.estimate_filter == "estimate" else 1.0,
        error_differenced=readings.error_rate == "difference_of_error",
        to_joint=to_joint,
        from_joint=np.asarray(np.linalg.inv(to_joint), dtype=np.float64),
        stores_applied=readings.stored_torque == "applied",
        motor_side=readings.feedback == "motor",
        feed_forward=0.0 if readings.reference_acceleration == "absent" else 1.0,
    )


def slow_error_ratio(config: CompareConfig, pair: Sequence[str]) -> Array:
    """Error of one of ``control.laws`` over that of another under a slow load, (n,); see `error_ratio`."""
    one, other = (build_law(config, name) for name in pair)
    delay = int(config.manipulator.actuator.output_delay.si)
    return control.error_ratio(one, other, float(np.deg2rad(control.TYPICAL_ERROR_DEG)), delay)


def power_floor(resolution: Value, scale: float) -> Value:
    """``Law.power_floor`` with joint encoders of a resolution, rad, and angles in `scale` units a radian."""
    # Of a symbol, too: the page in a browser can move the resolution.
    floor: Value = np.maximum(resolution, RESOLVED_ANGLE) * scale
    return floor


def _boundary(gains: Gains, readings: Readings) -> Array:
    """Δ in the unit of ``phi``'s argument; a reading in degrees takes the printed number."""
    if readings.gain_unit != "radian":
        return np.array(gains.Delta.value)
    return gains.Delta.si * (np.pi / 180.0) if readings.Delta_unit == "deg" else gains.Delta.si


def torque_map(config: CompareConfig) -> Array:
    """Map from the law's torque to joint coordinates, (n, n); by virtual work ``S_invᵀ``."""
    readings, reduction = config.control.readings, config.manipulator.winches.reduction.si
    rated = reduction * published().number("hardware.rated_torque")
    # Drives of this family take 3 V for the rated torque.
    units = {"newton_metre": 1.0, "percent_of_rated": 0.01 * rated, "volt": 1.0 / 3.0 * rated}
    scale = units[readings.torque_unit]
    if readings.torque_coordinates == "joint":
        return scale * np.eye(len(config.joints))
    if readings.torque_coordinates == "motor_shaft" and readings.torque_unit == "newton_metre":
        scale = reduction
    return np.ascontiguousarray(scale * rig.coupling(config)[1].T)


class Once:
    """Builds each part of closed loops once for the sections of a configuration that it depends on.

    Configurations of the same plant under other readings share what these leave alone.
    """

    def __init__(self) -> None:
        self._built: dict[Hashable, Any] = {}

    def __call__(self, build: Callable[..., Part], depends_on: Hashable, *given: Any) -> Part:
        """Part that `build` makes of what is given, or made before where it depends on equal sections."""
        key = build, depends_on
        part: Part | None = self._built.get(key)  # looked up once, for a hash of sections takes its time
        if part is None:
            part = self._built[key] = build(*given)
        return part


def build_loops(config: Config, folder: Path) -> Iterator[tuple[str, Loop]]:
    """One closed loop per run, with the run's name."""
    if isinstance(config, CompareConfig):
        once, reference = Once(), compared_reference(config, folder)
        for name in config.runs:
            yield name, run_loop(config, name, reference, once)
        return
    S, S_inv = rig.coupling(config)
    loop = config.position_loop
    servo = control.Servo(loop.stiffness.si, loop.damping.si, S_inv, config.sampling_period.si)
    for name, choice in config.runs.items():
        mapped = S if choice.drives == "motors" else None
        reference = build_reference(choice.reference, config, folder, mapped, f"runs.{name}.reference")
        plant = rig.build_plant(config, choice.payload.si)
        yield name, _loop(config, plant, rig.build_actuator(config), PositionController(servo), reference)


def compared_reference(config: CompareConfig, folder: Path) -> DesiredMotion:
    """Desired motion of all runs of a comparison, which its tables do not leave out."""
    reference = build_reference(config.reference, config, folder)
    if errors_from(config) >= reference.time[-1]:
        message = f"must be before the end of the motion, {reference.time[-1]:g} s"
        raise ConfigError(message, where="errors_from")
    return reference


def run_loop(config: CompareConfig, name: str, reference: DesiredMotion, once: Once) -> Loop:
    """Closed loop of one run of a comparison, following `reference`."""
    run, arm, section = config.runs[name], config.manipulator, config.control
    # Sections that parts are built of, without those that the most readings change.
    moved = tuple(part for key, part in arm if key not in ("encoders", "actuator"))
    plant_sections = moved, config.posture, config.disturbance, config.seed, run.payload, run.friction_scale
    law_sections = (
        (section.gains, section.readings, section.filter_cutoff, section.laws[run.law]),
        (arm.routing, arm.winches, arm.encoders.joint, config.sampling_period),
    )
    loop = _loop(
        config,
        once(rig.build_plant, plant_sections, config, run.payload.si, run.friction_factor),
        once(rig.build_actuator, arm.actuator, config),
        TimeDelayController(once(build_law, law_sections, config, run.law)),
        reference,
    )
    return replace(
        loop,
        cold=section.readings.start == "cold",
        start_offset=run.start_offset.si if run.start_offset else None,
        reference_lag=reference_lag(config),
    )


def case_loops(
    config: CompareConfig,
    cases: Sequence[Case],
    draw: Mapping[str, float],
    folder: Path,
    motions: Once,
    laws: Sequence[UserLaw] = (),
) -> list[Loop]:
    """Closed loops of one plant by case; parts that readings leave alone are built once and shared.

    `draw` has the numbers that readings may ask for, see `under`. `motions` keeps desired motions, for other
    plants on the same. Runs of a user's `laws` are on lanes.
    """
    once, runs_under = Once(), defaultdict[Reading, list[str]](list)
    for run, reading in cases:
        runs_under[reading].append(run)
    loops: dict[Case, Loop] = {}
    for reading, runs in runs_under.items():
        changed = under(reading, config, draw)
        moves = changed.reference, changed.posture, changed.sampling_period, changed.errors_from
        reference = motions(compared_reference, moves, changed, folder)
        # A user's law runs on the plants of configured runs.
        names = config.runs if laws else runs
        of_reading = {name: run_loop(changed, name, reference, once) for name in names}
        for law in laws:
            of_reading |= own_loops(law, config, of_reading, lane_function(law))
        loops |= {(run, reading): of_reading[run] for run in runs}
    return [loops[case] for case in cases]


def all_loops(loaded: LoadedConfig, laws: Sequence[UserLaw] = ()) -> dict[str, Loop]:
    """Closed loops of all runs by name, a user's laws last."""
    try:
        loops = dict(build_loops(loaded.config, loaded.folder))
    except ConfigError as error:
        key = error.where or ""
        if not key.endswith("reference"):  # a file of its motion, with a line
            raise
        where = loaded.place(*key.split("."), "amplitude", "value")
        raise ConfigError(f"{key}: {error.message}", where=where, hint=error.hint) from None
    for law in laws:
        assert isinstance(loaded.config, CompareConfig)
        # A run that --controllers left out would be taken for that of the paper.
        if law.name in (*loops, *RUNS, RESERVED):
            message = f"there is something else of the name {law.name!r} among the results"
            raise UsageError(message, where="--law", hint="give the function another name")
        loops |= own_loops(law, loaded.config, loops)
    return loops


def reference_lag(config: CompareConfig) -> float:
    """Time constant by which laws get the reference's rates late, s."""
    lag = config.control.reference_lag
    late = config.control.readings.reference_acceleration == "late"
    return lag.si if late and lag is not None else 0.0


def _loop(
    config: Config,
    plant: dynamics.Plant,
    actuator: drive.Actuator,
    controller: TimeDelayController | PositionController,
    reference: DesiredMotion,
) -> Loop:
    solver = config.solver
    return Loop(
        plant=plant,
        joint_encoder=rig.build_encoder(config.manipulator.encoders.joint),
        motor_encoder=rig.build_encoder(config.manipulator.encoders.motor),
        actuator=actuator,
        controller=controller,
        reference=reference,
        L=config.sampling_period.si,
        solver=Solver(solver.method, solver.rtol.si, solver.atol.si, solver.max_step.si),
        divergence_limit=config.status.divergence_limit.si,
        ringing_frequency=config.status.ringing_frequency.si,
        ringing_share=config.status.ringing_share.si,
        cold=False,
        seed=int(config.seed.si),
    )


def run_status(loop: Loop, variables: Mapping[str, Array]) -> tuple[metrics.Status, float]:
    """Status of a run and its time, as `status_of`; one shorter than its reference has diverged."""
    time = variables["time"]
    if time.size < loop.reference.time.size:
        return "diverged", float(time[-1])
    limits = loop.divergence_limit, loop.ringing_frequency, loop.ringing_share
    return metrics.status_of(time, variables["e"], *limits)


class View(NamedTuple):
    """One run as a linear loop."""

    law_name: str
    law: control.Law
    plant: dynamics.Plant
    payload: float
    delay: int


def run_views(config: CompareConfig) -> dict[str, View]:
    """Law, plant and delay of every run."""
    delay = int(config.manipulator.actuator.output_delay.si)
    views = {}
    for name, run in config.runs.items():
        plant = rig.build_plant(config, run.payload.si, run.friction_factor)
        views[name] = View(run.law, build_law(config, run.law), plant, run.payload.si, delay)
    return views


def growing(loops: Mapping[str, Loop]) -> dict[str, float]:
    """Runs of the package's own laws whose linear loop grows somewhere on the motion, and the frequency, Hz.

    A run may end before slow growth is seen in its status.
    """
    frequencies = {}
    for name, loop in loops.items():
        if isinstance(loop.controller, TimeDelayController) and loop.controller.command is None:
            law, postures = loop.controller.law, linear_loop.stroke(loop.reference.q_d)
            matrices = [linear_loop.loop_matrix(q, loop.plant, law, loop.actuator.delay) for q in postures]
            growth, hertz = linear_loop.slowest(
                [linear_loop.modes(matrix, law.L) for matrix in matrices], 0.0
            )
            if growth > 0.0:
                frequencies[name] = hertz
    return frequencies
