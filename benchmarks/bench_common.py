"""What the benchmarks share: the cases they simulate, clocks, and the entries they print."""

from __future__ import annotations

import platform
import re
import sys
import time
from pathlib import Path

# The package is imported where it is used; see bench.py.

ROOT = Path(__file__).parent.parent
REFERENCE_RTOL = 1e-13
IDEAL_ENCODER = ("manipulator.encoders.joint.resolution=0",)
"""A flipped encoder count would drown the integrators' errors."""


def stated_case(duration, overrides=IDEAL_ENCODER):
    """Closed loop of Controller 1, the baselines' parameters and reference, all of one shortened run."""
    from dataclasses import replace

    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.loops import build_loops
    from tendonrepro.simulation.loop import DesiredMotion

    # The arm and motion that the stated ratios are of.
    loaded = load_config("plain", "compare", overrides=overrides)
    loop = dict(build_loops(loaded.config, loaded.folder))["controller_1"]
    samples = round(duration / loop.L) + 1
    names = ("time", "q_d", "dq_d", "ddq_d")
    reference = {name: getattr(loop.reference, name)[:samples] for name in names}
    shortened = replace(loop, reference=DesiredMotion(**reference))
    return shortened, plain_parameters(loaded.config), reference


def tightened(loop):
    """The same run at tolerances where rounding is all that is left."""
    from dataclasses import replace

    solver = replace(loop.solver, method="dop853", rtol=REFERENCE_RTOL, atol=REFERENCE_RTOL / 100.0)
    return replace(loop, solver=solver)


def plain_parameters(config):
    """The configuration's numbers for the baseline, SI units, moving joints only."""
    from tendonrepro.experiments.rig import coupling, start_angles

    n = len(config.joints)
    arm, run = config.manipulator, config.runs["controller_1"]
    links, winches, tendons, dry = arm.links, arm.winches, arm.tendons, arm.friction
    radius = arm.routing.winch_diameter.si[-n:] / 2.0
    law = ("coulomb", "static_ratio", "stribeck_velocity", "smoothing_velocity")
    gains = ("M_bar", "lam", "b", "eta", "Delta", "alpha")
    return {name: getattr(links, name).si[-n:] for name in ("length", "mass", "com", "inertia")} | {
        "payload": run.payload.si,
        "gravity": arm.gravity.si,
        "start_angle": start_angles(config),
        "S_inv": coupling(config)[1],
        "winch_inertia": (winches.reflected_inertia.si + winches.drum_inertia.si)[-n:],
        "winch_stiffness": tendons.axial_stiffness.si[-n:] * radius**2,
        "winch_damping": tendons.damping_factor.si * tendons.axial_damping.si[-n:] * radius**2,
        "winch_friction": {name: getattr(dry.winch, name).si[-n:] for name in law}
        | {"viscous": winches.viscous.si[-n:]},
        "link_friction": {name: getattr(dry.link, name).si[-n:] for name in (*law, "viscous")},
        "torque_limit": arm.actuator.torque_limit.si[-n:],
        "encoder_step": arm.encoders.joint.resolution.si,
        "L": config.sampling_period.si,
        "gains": {name: getattr(config.control.gains, name).si for name in gains},
    }


def case(what, experiments_per_second, ratio_to_baselines, max_error_rad, bars):
    """Entry of the result; None is what a case does not measure."""
    return {
        "what": what,
        "cpu": cpu(),
        "experiments_per_second": experiments_per_second,
        "ratio_to_baselines": ratio_to_baselines,
        "max_error_rad": max_error_rad,
        "bars": bars,
    }


def bar(value, limit, *, at_least=False):
    return {"value": value, "bar": limit, "met": value >= limit if at_least else value <= limit}


def cpu():
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*: (.+)", info.read_text()) if info.exists() else None
    return found[1] if found else platform.processor() or platform.machine()


def largest(difference):
    return float(abs(difference).max())


def seconds_of(work):
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def say(text):
    print(text, file=sys.stderr, flush=True)
