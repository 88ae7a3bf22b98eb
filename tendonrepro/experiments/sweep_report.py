"""What a sweep shows: JSON, tables, terminal and figure."""

from __future__ import annotations

from collections.abc import Iterator

from tendonrepro.experiments.sweep import IN_DEGREES, IN_SI, Sweep, text_of
from tendonrepro.results.tables import Table
from tendonrepro.simulation.resolution import COMPILED_STEPPER
from tendonrepro.studies.result import Result


def sweep_result(sweep: Sweep) -> Result:
    """All views of a sweep."""
    from tendonrepro.experiments.figures_sweep import draw_sweep

    grid = sweep.grid
    manifest = {"solver": {"name": COMPILED_STEPPER}, "over": grid.words, "points": len(grid.points)}
    figures = {"sweep": lambda: draw_sweep(sweep)}
    diverged = bool(sweep.named("diverged"))
    return Result(sweep_data(sweep), _tables(sweep), figures, manifest, diverged=diverged)


def sweep_data(sweep: Sweep) -> dict[str, object]:
    """Numbers by the keys of ``--json``; what does not exist is NaN."""
    grid = sweep.grid
    return {
        "schema_version": 1,
        "experiment": "sweep",
        "config": grid.base.origin,
        "config_sha256": grid.base.sha256,
        "joints": list(grid.joints),
        "runs": grid.runs,
        "keys": [
            {
                "key": axis.key,
                "unit": axis.unit,
                "values": axis.values,
                "texts": [text_of(value) for value in axis.values],
                "numbers": axis.numbers,
            }
            for axis in grid.axes
        ],
        "points": [
            {
                "label": point.label,
                "values": point.values,
                "places": point.places,
                "runs": {run: _run_data(sweep, p, r) for r, run in enumerate(grid.runs)},
                "ratio": {pair: ratio.simulated[p].tolist() for pair, ratio in sweep.ratios.items()},
                "predicted_ratio": {
                    pair: ratio.predicted[p].tolist() for pair, ratio in sweep.ratios.items()
                },
            }
            for p, point in enumerate(grid.points)
        ],
        "status": {
            f"{point.label} {run}": str(sweep.status[p, r])
            for p, point in enumerate(grid.points)
            for r, run in enumerate(grid.runs)
        },
        "diverged": sweep.named("diverged"),
    }


def _run_data(sweep: Sweep, p: int, r: int) -> dict[str, object]:
    return {
        "status": str(sweep.status[p, r]),
        "status_time_s": float(sweep.status_time[p, r]),
        "steps_per_sample": int(sweep.steps[p, r]),
    } | {name: size[p, r].tolist() for name, size in sweep.sizes.items()}


def _tables(sweep: Sweep) -> list[Table]:
    """A short table for the terminal, and one of everything."""
    grid = sweep.grid
    swept = f"{grid.base.origin} over {' and '.join(axis.key for axis in grid.axes)}"
    points = f"{swept}: MAE of each run, deg, and ratios of MAE."
    every = f"{swept}, sweep {grid.base.sha256[:12]}. A diverged run has its numbers up to its end."
    return [
        Table("points", points, list(point_rows(sweep))),
        Table("sweep", every, list(run_rows(sweep)), terminal=()),
    ]


def point_rows(sweep: Sweep) -> Iterator[dict[str, object]]:
    """MAE of every run, ratios, and the runs that are not ok."""
    runs, mae = sweep.grid.runs, sweep.sizes["mae_deg"]
    for p, point in enumerate(sweep.grid.points):
        bad = [f"{run} {status}" for run, status in zip(runs, sweep.status[p], strict=True) if status != "ok"]
        for k, joint in enumerate(sweep.grid.joints):
            row = {"point": point.label, "joint": joint}
            row |= {run: float(mae[p, r, k]) for r, run in enumerate(runs)}
            row |= {pair: float(ratio.simulated[p, k]) for pair, ratio in sweep.ratios.items()}
            yield row | {"status": bad or "ok"}


def run_rows(sweep: Sweep) -> Iterator[dict[str, object]]:
    """Values of the keys, then all numbers of a run and joint."""
    for p, point in enumerate(sweep.grid.points):
        texts = {key: text_of(value) for key, value in point.values.items()}
        for r, run in enumerate(sweep.grid.runs):
            for k, joint in enumerate(sweep.grid.joints):
                yield {
                    **texts,
                    "run": run,
                    "joint": joint,
                    "status": str(sweep.status[p, r]),
                    "status_time_s": float(sweep.status_time[p, r]),
                    **{name: float(sweep.sizes[name][p, r, k]) for name in (*IN_DEGREES, *IN_SI)},
                }
