"""Claim T1: whether every tendon stays in tension, per course of tendon 4."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.box import PER_JOINT, Joint
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.experiments.statics import COURSES, Mechanism, mechanism
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.monte_carlo.shares import share_of
from tendonrepro.physics.arm import weight_moment
from tendonrepro.physics.statics import SLACK, tendon_tension
from tendonrepro.verdicts.rules import Evidence, Mask, Ruling, Rulings, not_testable, of_claim, of_courses

MARGINS = (5.0, 10.0, 20.0)
"""How far every link stays away from the edges of the half-plane, deg; a verdict has to hold for all."""

_LINKS = ("length", "mass", "com")

DRAWS = 1024
"""Plants drawn where no ensemble is at hand, as many as `tendonrepro ensemble` draws."""


class PlantsAtRest(NamedTuple):
    """N plants at rest, each with its scrambling.

    ``moment`` (3, N), N m, is of horizontal links; ``force`` (N,), N, of tendon 4.
    """

    moment: Array
    force: Array
    replicate: NDArray[np.int64]


def tension(data: EnsembleData | None) -> Rulings:
    """T1 on the draws of an ensemble, else of the shipped box."""
    config = load_config(None, "decouple").config
    plants = plants_at_rest(data, config.manipulator)
    courses = {course: _course(course, mechanism(config, course), plants) for course in COURSES}
    evidence: Evidence = {
        "courses": [ruling.evidence for ruling in courses.values()],
        "link_angles_deg": [[margin, 180.0 - margin] for margin in MARGINS],
        "remarks": [
            "the course of tendon 4 is not printed; at rest",
            "that a motor's pull is constant is an input of the model, no result",
        ],
    }
    return {
        PRINTED: replace(of_courses(list(courses.values())), evidence=evidence),
        **{f"tensioner={course}": ruling for course, ruling in courses.items()},
        # The claim is about tendon 4, so a machine without it can tell nothing.
        "tensioner=absent": not_testable("tendon 4"),
    }


def _course(course: str, route: Mechanism, plants: PlantsAtRest) -> Ruling:
    """T1 with one course of tendon 4, where all margins agree."""
    travel = route.travel()
    shares, by_margin = {}, []
    for margin in MARGINS:
        tense = _tense(margin, plants, route)
        masks = (tense & (travel > 0.0), ~tense & (travel <= 0.0), tense)
        whole, opposite, kept = (share_of(hits, plants.replicate) for hits in masks)
        by_margin.append(of_claim(whole, opposite))
        shares[f"at_{margin:g}_deg"] = asdict(kept) | {"verdict": by_margin[-1].verdict}
    ruling = of_courses(by_margin)
    evidence = {
        "course": course,
        "verdict": ruling.verdict,
        "borderline": ruling.borderline,
        "every_tendon_tense": shares,
        "spring_varies": travel > 0.0,
        "length_change_mm": 1e3 * travel,
    }
    return replace(ruling, evidence=evidence)


def _tense(margin: float, plants: PlantsAtRest, route: Mechanism) -> Mask:
    """Whether every tendon pulls in all postures at least `margin` deg from the edges, (N,).

    Tension is linear in the sines of the angles, so their extremes tell.
    """
    sines = np.array(list(product((np.sin(np.deg2rad(margin)), 1.0), repeat=3))).T
    moments = plants.moment[:, np.newaxis] * sines[:, :, np.newaxis]
    weight = np.cumsum(moments[::-1], axis=0)[::-1]
    pull = np.multiply.outer(route.per_newton(), plants.force)
    tension = tendon_tension(weight, route.S, route.winch) + pull[:, np.newaxis]
    return np.asarray((tension > SLACK).all(axis=(0, 1)))


@cache
def _shipped_draws() -> tuple[tuple[str, ...], Array, NDArray[np.int64]]:
    loaded = load_ensemble(None)
    box, seed = population_of(loaded), int(loaded.config.seed.si)
    replicates = int(loaded.config.scramblings.si)
    each = DRAWS // replicates
    draws = [box.sample(seed, k, 0, each) for k in range(replicates)]
    return box.names, np.concatenate(draws), np.repeat(np.arange(replicates), each)


def plants_at_rest(data: EnsembleData | None, manipulator: Manipulator) -> PlantsAtRest:
    """Plants of an ensemble, else of the shipped box."""
    if data is not None and "tensioner_force" in data.names:
        names, draws, replicate = data.names, data.draws, data.replicate
    else:
        names, draws, replicate = _shipped_draws()
    draw = dict(zip(names, draws.T, strict=True))
    # The box has no link 1, which is held in the comparison.
    links = {key: [np.full(len(draws), getattr(manipulator.links, key).si[0])] for key in _LINKS}
    for joint in (2, 3):
        of = Joint(draw[f"link_length_{joint}"], draw[f"link_mass_{joint}"])
        for key, values in links.items():
            values.append(PER_JOINT[f"link_{key}"].put(draw[f"link_{key}_{joint}"], of))
    length, mass, com = (np.array(links[key]) for key in _LINKS)
    moment = weight_moment(length, mass, com, payload_mass=0.0, gravity=manipulator.gravity.si)
    return PlantsAtRest(moment, draw["tensioner_force"], replicate)
