"""The paper's two experiments as studies, and the fit that runs beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tendonrepro.configuration.load import ExperimentName, load_config
from tendonrepro.configuration.overrides import Overrides
from tendonrepro.experiments.run import Prepared, prepared, results_of
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table
from tendonrepro.studies.parameters import Folder
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Study

CLOSEST = "closest"
"""Name of the shipped configuration that was fitted to Tables 2 and 3."""


def experiment_study(experiment: Prepared, folder: Folder) -> Study:
    """One of the paper's experiments as a study of its own."""
    loaded = experiment.loaded
    samples = {name: loop.reference.time.size for name, loop in experiment.loops.items()}
    plan = {"experiment": loaded.config.experiment, "config": loaded.origin, "samples": samples}
    return Study(
        loaded,
        lambda site: next(results_of([experiment], site.talk, site.start)),
        folder,
        numbers=None,
        plan=plan,
        command=loaded.config.experiment,
    )


def paper_experiments(
    configs: Path | None, changes: Overrides | None, seed: int | None
) -> dict[str, Prepared]:
    """Both experiments of the paper, and the comparison fitted to its tables.

    `configs` is a folder with ``decouple.yaml`` and ``compare.yaml``. The fitted plant runs only as it is
    shipped.
    """
    names: tuple[ExperimentName, ...] = ("decouple", "compare")
    files = {name: None if configs is None else str(configs / f"{name}.yaml") for name in names}
    experiments: dict[str, Prepared] = {
        name: prepared(load_config(files[name], name, overrides=changes, seed=seed)) for name in names
    }
    if configs is None and not changes and seed is None:
        experiments[CLOSEST] = prepared(load_config(CLOSEST, "compare"))
    return experiments


def summary_of(answers: Mapping[str, Answer[Result]]) -> str:
    """Mean errors as published, fitted and printed, where both comparisons were run."""
    if not {"compare", CLOSEST} <= answers.keys() or "table2" not in answers[CLOSEST].data:
        return ""
    ours, fitted = answers["compare"].value, answers[CLOSEST].value
    tables = {
        "as published, on our typical arm": ours.data["table2"],
        "fitted to the paper's tables": fitted.data["table2"],
        "paper": fitted.data["printed"]["table2"],
    }
    rows = [
        {"MAE of joint 2 / joint 3, degrees": name}
        | {run: " / ".join(f"{size:.3f}" for size in table[run]["mae_deg"]) for run in CONTROLLERS}
        for name, table in tables.items()
    ]
    return Table("summary", "The fit used the paper's tables, so its agreement proves nothing.", rows).text()
