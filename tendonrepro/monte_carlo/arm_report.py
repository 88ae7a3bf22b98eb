"""Tables of an ensemble around an arm of one's own: which controller errs less, and how often."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from tendonrepro.configuration.models.control import PAYLOAD
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shares import quantiles_of, share_of
from tendonrepro.monte_carlo.summary import PairRow, PopulationSummary, Summary
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table, TableRows

_FORMS = {"ratio": ".3g", "ratio_low": ".3g", "ratio_high": ".3g"} | dict.fromkeys(
    ("share_smaller", "share_low", "share_high", *STATUSES), ".0%"
)


def pairs_of(data: EnsembleData) -> list[tuple[str, str]]:
    """Runs that are compared: the three controllers, and others without payload with each of these."""
    others = [run for run in data.runs if run not in CONTROLLERS and not run.endswith(PAYLOAD)]
    return [*combinations(CONTROLLERS, 2), *product(others, CONTROLLERS)]


@np.errstate(invalid="ignore")  # where a run diverged
def pair_rows(data: EnsembleData) -> Iterator[PairRow]:
    """Mean absolute error of one run over another's on the arms where both are stable, by joint.

    ``ratio`` is the median, ``ratio_low`` and ``ratio_high`` the ends of the central 90 % of the arms.
    ``share_smaller`` is the share of arms on which the first errs less, with its 95 % interval.
    """
    stable = STATUSES.index("ok")
    for reading, (first, over) in product(data.readings, pairs_of(data)):
        kept = (data.status(first, reading) == stable) & (data.status(over, reading) == stable)
        errors = [data.statistic(run, reading, "mae")[kept] for run in (first, over)]
        for i, joint in enumerate(data.joints):
            above, below = (sizes[:, i] for sizes in errors)
            ratio = quantiles_of(above / below, data.replicate[kept])
            share = share_of(above < below, data.replicate[kept]).as_row()
            yield {
                "reading": reading,
                "run": first,
                "over": over,
                "joint": joint,
                "arms": int(kept.sum()),
                "ratio": ratio["median"]["value"],
                "ratio_low": ratio["q05"]["value"],
                "ratio_high": ratio["q95"]["value"],
                "share_smaller": share["share"],
                "share_low": share["low"],
                "share_high": share["high"],
            }


def _stability_rows(population: PopulationSummary) -> Iterator[dict[str, object]]:
    for reading in population["readings"]:
        for run, shares in reading["status"].items():
            yield {
                "reading": reading["name"],
                "run": run,
                **{name: shares[name]["share"] for name in STATUSES},
            }


def _columns(rows: TableRows) -> dict[str, tuple[str, str]]:
    """Headings and formats; the reading is left out where there is no other."""
    alone = {row["reading"] for row in rows} == {PRINTED}
    names = [name for name in rows[0] if not (alone and name == "reading")]
    return {name: (name.replace("_", " "), _FORMS.get(name, "")) for name in names}


def arm_tables(summary: Summary) -> Iterator[Table | str]:
    """Yield the comparison of the runs, and how often each is stable."""
    (population,) = summary["populations"].values()
    pairs, stability = population["pairs"], [*_stability_rows(population)]
    on = f"{population['plants']} arms {summary['around']['told']}"
    about = (
        f"Mean absolute error of one run over another's on {on}, where both are stable: median, central "
        "90 % of the arms, and the share of arms on which the first errs less, with its 95 % interval."
    )
    yield Table("pairs", about, pairs, _columns(pairs))
    yield Table(
        "stability", f"Share of {on} on which each run has which status.", stability, _columns(stability)
    )
    if not any(row["arms"] for row in pairs):
        yield "No two runs are stable on one arm. tendonrepro explain says how far from stable each loop is."
