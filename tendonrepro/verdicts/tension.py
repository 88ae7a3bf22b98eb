"""Claim T1: whether every tendon stays in tension, per course of tendon 4, over the plants of the box."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.statics.command import COURSES, Mechanism, mechanism
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.draw import put_links
from tendonrepro.monte_carlo.shares import share_of
from tendonrepro.physics.arm import weight_moment
from tendonrepro.physics.statics import (
    SLACK,
    tendon_tension,
    tensioner_stretch,
    tensioner_torque,
)
from tendonrepro.verdicts.rules import Decision, Judged, Mask, of_claim, of_courses

MARGINS = (5.0, 10.0, 20.0)
"""How far every link stays away from the edges of the half-plane, deg; a verdict has to hold for all."""

DRAWS = 1024
"""Plants drawn where no ensemble is at hand, as many as `tendonrepro ensemble` draws."""


class Machines(NamedTuple):
    """N draws as far as they matter at rest.

    ``moment`` (3, N), N m, of horizontal links; ``force`` (N,) of tendon 4, N; ``replicate`` (N,) the
    scrambling.
    """

    moment: Array
    force: Array
    replicate: NDArray[np.int64]


def tension(data: EnsembleData | None) -> Judged:
    """T1 on the draws of an ensemble, or on as many of the shipped box where there is none."""
    machines = _machines(data)
    rows = [_course(course, mechanism(_arm(), course), machines) for course in COURSES]
    verdicts = {f"tensioner={row['course']}": row["verdict"] for row in rows}
    decision = of_courses([Decision(row["verdict"], row["borderline"]) for row in rows])
    remarks = [
        "the course of tendon 4 is not printed; at rest",
        "that a motor's pull is constant is an input of the model, no result",
    ]
    # The claim is about tendon 4, so a machine without it can tell nothing.
    readings = verdicts | {"tensioner=absent": "not_testable"}
    evidence = {
        "courses": rows,
        "link_angles_deg": [[margin, 180.0 - margin] for margin in MARGINS],
        "remarks": remarks,
    }
    return Judged(decision, None, evidence, readings)


def _course(course: str, route: Mechanism, machines: Machines) -> dict[str, Any]:
    side, diameter = route.side[:, -1], route.diameter[:, -1]
    corners = np.array(list(product((0.0, np.pi), repeat=len(side)))).T
    joints = np.diff(corners, axis=0, prepend=0.0)
    travel = float(np.ptp(tensioner_stretch(joints, side, diameter)))
    varies = np.full(len(machines.force), travel > 0.0)
    shares, decisions = {}, []
    for margin in MARGINS:
        tense = _tense(_corner_torque(margin, machines), machines.force, route)
        masks = (tense & varies, ~tense & ~varies, tense)
        whole, opposite, kept = (share_of(hits, machines.replicate) for hits in masks)
        decisions.append(of_claim(whole, opposite))
        shares[f"at_{margin:g}_deg"] = asdict(kept) | {"verdict": decisions[-1].verdict}
    decision = of_courses(decisions)
    return {
        "course": course,
        "verdict": decision.verdict,
        "borderline": decision.borderline,
        "every_tendon_tense": shares,
        "spring_varies": travel > 0.0,
        "length_change_mm": 1e3 * travel,
    }


def _corner_torque(margin: float, machines: Machines) -> Array:
    """Joint torque of the weight, N m, (3, corners, N), where tensions are extreme.

    Tension is linear in the sine of every link's angle, so over all postures at least `margin` deg from the
    edges it is least where each sine is either its least or one: no grid in between can be lower.
    """
    sines = np.array(list(product((np.sin(np.deg2rad(margin)), 1.0), repeat=3))).T
    moments = machines.moment[:, np.newaxis] * sines[:, :, np.newaxis]
    return np.cumsum(moments[::-1], axis=0)[::-1]


def _tense(weight: Array, force: Array, route: Mechanism) -> Mask:
    """Whether every tendon pulls at all of some postures, (N,)."""
    net = weight - tensioner_torque(force, route.side[:, -1], route.diameter[:, -1])[:, np.newaxis]
    return np.asarray((tendon_tension(net, route.S, route.winch) > SLACK).all(axis=(0, 1)))


@cache
def _arm() -> Any:
    return load_config(None, "decouple").config


@cache
def _shipped_draws() -> tuple[tuple[str, ...], Array, NDArray[np.int64]]:
    """Names, draws and scramblings of the shipped box."""
    config = load_ensemble(None).config
    box, seed, replicates = make_box(config), int(config.seed.si), int(config.scramblings.si)
    each = DRAWS // replicates
    draws = [box.values(scrambled_sobol(box, seed, k, 0, each)) for k in range(replicates)]
    return box.names, np.concatenate(draws), np.repeat(np.arange(replicates), each)


def _machines(data: EnsembleData | None) -> Machines:
    if data is not None and "tensioner_force" in data.names:
        names, draws, replicate = data.names, data.draws, data.replicate
    else:
        names, draws, replicate = _shipped_draws()
    draw, manipulator = dict(zip(names, draws.T, strict=True)), _arm().manipulator
    tree: dict[str, Any] = {}
    put_links(tree, draw)
    links = {key: np.array(tree[key]["value"]) for key in ("length", "mass", "com")}
    for key, values in links.items():
        # The box has no link 1, which is held in the comparison.
        values[0] = getattr(manipulator.links, key).si[0]
    moment = weight_moment(**links, payload_mass=0.0, gravity=manipulator.gravity.si)
    return Machines(moment, draw["tensioner_force"], replicate)
