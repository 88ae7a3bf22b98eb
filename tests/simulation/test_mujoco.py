"""The same plant in MuJoCo, an independent program, fed with the torque of our own runs.

MuJoCo gets bodies, joints and tendons as one would draw them: links with their masses, one drum per motor,
and one tendon per motor, in metres of rope over the diameters of the configuration. None of our matrices goes
in. Dry friction comes through its passive callback, since its own friction is another law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support.oracles import Routing, rope_used, winch_angles
from support.overrides import PLAIN_ARM

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops
from tendonrepro.simulation.stepper import simulate

Array = NDArray[np.float64]

L = 1e-3
SUBSTEPS = 16
"""Steps of MuJoCo's Runge-Kutta method in one sample, aligned with the jumps of the torque."""

ARMS = {
    "2 joints, payload": ("plain", "controller_1_payload", ()),
    "3 joints, payload": (
        "decouple",
        "decouple",
        (PLAIN_ARM, "runs.decouple.reference.turns=[[1, 2, 3]]", "runs.decouple.payload=0.2"),
    ),
}


class Recorded(NamedTuple):
    """One of our runs: what MuJoCo is told, and what it should find."""

    config: Any
    payload: float
    tau_m: Array
    q: Array
    theta: Array


@cache
def recorded(experiment: Any, run: str, overrides: tuple[str, ...], seconds: float) -> Recorded:
    loaded = load_config(experiment, None, overrides=overrides)
    loop = dict(build_loops(loaded.config, loaded.folder))[run]
    samples = round(seconds / L) + 1
    reference = loop.reference
    parts = (reference.time, reference.q_d, reference.dq_d, reference.ddq_d)
    trace = simulate(replace(loop, reference=type(reference)(*(part[:samples] for part in parts))))
    assert trace["time"].size == samples
    payload = loaded.config.runs[run].payload.si
    return Recorded(loaded.config, payload, trace["tau_m"], trace["q"], trace["theta"])


def routing_of(config: Any) -> Routing:
    routing = config.manipulator.routing
    return Routing(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)


def rope_per_joint(config: Any) -> Array:
    """Rope in m that each moving tendon (row) needs for one radian of each moving joint (column)."""
    moving = np.array(config.joints) - 1
    columns = [rope_used(axis, routing_of(config)) for axis in np.eye(config.manipulator.joints)]
    return np.column_stack(columns)[np.ix_(moving, moving)]


def model_xml(config: Any, payload: float, substeps: int) -> str:
    """Arm hanging along -z and turning about y, which lifts it towards -x, and drums beside it."""
    parts = ['<mujoco><compiler angle="radian" inertiafromgeom="false"/>']
    parts.append(f'<option integrator="RK4" timestep="{L / substeps!r}"')
    parts.append(f' gravity="0 0 {-config.manipulator.gravity.si!r}">')
    parts.append('<flag contact="disable" limit="disable"/></option><worldbody>')
    parts.extend(_arm(config, payload))
    parts.extend(_drums(config))
    parts.append("</worldbody><tendon>")
    parts.extend(_tendons(config))
    parts.append("</tendon></mujoco>")
    return "".join(parts)


def _inertial(mass: float, height: float, inertia: float) -> str:
    # Only the inertia about y matters in a plane; equal ones are always admissible.
    return (
        f'<inertial pos="0 0 {height!r}" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
    )


def _arm(config: Any, payload: float) -> Iterator[str]:
    links, viscous = config.manipulator.links, config.manipulator.friction.link.viscous.si
    height = 0.0
    for i in range(config.manipulator.joints):
        half = float(config.posture.si[i]) / 2
        yield f'<body pos="0 0 {height!r}" quat="{math.cos(half)!r} 0 {math.sin(half)!r} 0">'
        if i + 1 in config.joints:
            yield f'<joint name="q{i + 1}" axis="0 1 0" damping="{float(viscous[i])!r}"/>'
        mass, com, inertia = (float(values.si[i]) for values in (links.mass, links.com, links.inertia))
        yield _inertial(mass, -com, inertia)
        height = -float(links.length.si[i])
    if payload:
        yield f'<body pos="0 0 {height!r}">{_inertial(payload, 0.0, 0.0)}</body>'
    yield "</body>" * config.manipulator.joints


def _drums(config: Any) -> Iterator[str]:
    winches = config.manipulator.winches
    inertia = winches.reflected_inertia.si + winches.drum_inertia.si
    for joint in config.joints:
        damping = float(winches.viscous.si[joint - 1])
        yield f'<body><joint name="w{joint}" axis="0 1 0" damping="{damping!r}"/>'
        yield _inertial(1e-3, 0.0, float(inertia[joint - 1])) + "</body>"


def _tendons(config: Any) -> Iterator[str]:
    tendons, radius = config.manipulator.tendons, config.manipulator.routing.winch_diameter.si / 2
    damping = tendons.damping_factor.si * tendons.axial_damping.si
    for joint, row in zip(config.joints, rope_per_joint(config), strict=True):
        n = joint - 1
        values = f'stiffness="{float(tendons.axial_stiffness.si[n])!r}" damping="{float(damping[n])!r}"'
        yield f'<fixed {values} springlength="0"><joint joint="w{joint}" coef="{float(radius[n])!r}"/>'
        for other, rope in zip(config.joints, row, strict=True):
            if rope:
                yield f'<joint joint="q{other}" coef="{-float(rope)!r}"/>'
        yield "</fixed>"


def dry_friction(config: Any) -> Callable[[Any, Any], None]:
    """Passive callback: the smooth Coulomb and Stribeck law on joints and drums."""
    rows = []
    for law in (config.manipulator.friction.link, config.manipulator.friction.winch):
        fields = (law.coulomb, law.static_ratio, law.stribeck_velocity, law.smoothing_velocity)
        rows.extend([tuple(float(field.si[joint - 1]) for field in fields) for joint in config.joints])

    def callback(_: Any, data: Any) -> None:
        speeds = data.qvel.tolist()
        lost = []
        for v, (coulomb, ratio, fading, smooth) in zip(speeds, rows, strict=True):
            rise = 1.0 + (ratio - 1.0) * math.exp(-((v / fading) ** 2))
            lost.append(-coulomb * rise * math.tanh(v / smooth))
        data.qfrc_passive[:] += lost

    return callback


@contextmanager
def passive(callback: Callable[[Any, Any], None]) -> Iterator[None]:
    import mujoco

    mujoco.set_mjcb_passive(callback)
    try:
        yield
    finally:
        mujoco.set_mjcb_passive(None)


def played(run: Recorded, substeps: int) -> tuple[Array, Array]:
    """Joint and drum angles at every sample when MuJoCo holds our torques, (T, n) each, rad."""
    import mujoco

    config, n = run.config, len(run.config.joints)
    model = mujoco.MjModel.from_xml_string(model_xml(config, run.payload, substeps))
    data = mujoco.MjData(model)
    radius = config.manipulator.routing.winch_diameter.si[-n:] / 2
    rope = rope_per_joint(config)
    mujoco.mj_forward(model, data)
    # At rest the tendons carry MuJoCo's own weight torque by virtual work on the rope.
    tension = np.linalg.solve(rope.T, data.qfrc_bias[:n])
    data.qpos[n:] = tension / config.manipulator.tendons.axial_stiffness.si[-n:] / radius
    drum_torque = np.linalg.solve(rope.T, run.tau_m.T).T * radius
    angles = np.empty((run.tau_m.shape[0], 2 * n))
    with passive(dry_friction(config)):
        for k, torque in enumerate(drum_torque):
            angles[k] = data.qpos
            data.qfrc_applied[n:] = torque
            mujoco.mj_step(model, data, nstep=substeps)
    return angles[:, :n], angles[:, n:]


def difference(run: Recorded, substeps: int = SUBSTEPS) -> float:
    """Largest difference of any joint or winch angle over the whole run, rad."""
    q, drum = played(run, substeps)
    held = np.zeros((run.theta.shape[0], run.config.manipulator.joints - len(run.config.joints)))
    winch = winch_angles(np.hstack([held, run.theta]).T, routing_of(run.config)).T[:, held.shape[1] :]
    return float(max(np.abs(q - run.q).max(), np.abs(drum - winch).max()))


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_mujoco_moves_the_same_arm_the_same_way(arm: tuple[str, str, tuple[str, ...]]) -> None:
    run = recorded(*arm, seconds=1.5)
    # Every joint moves.
    assert (np.ptp(run.q, axis=0) > 0.3).all()
    # Measured: 5e-10 rad with 2 joints, 1e-12 with 3 (a smoother torque); it is the error of MuJoCo's steps.
    assert difference(run) < 2e-9


def test_what_differs_is_the_error_of_mujocos_own_steps() -> None:
    """It falls with the fourth power of the step, as that of a Runge-Kutta method of fourth order."""
    experiment, name, overrides = ARMS["2 joints, payload"]
    run = recorded(experiment, name, (*overrides, "solver.rtol=1e-8", "solver.atol=1e-10"), seconds=0.5)
    coarse, fine = difference(run, SUBSTEPS // 2), difference(run, SUBSTEPS)
    # 16 in the limit of small steps.
    assert coarse / fine == pytest.approx(16.0, rel=0.15)
