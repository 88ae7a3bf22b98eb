"""A measurement beside the paper and beside the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.published import published
from tendonrepro.evidence.recover_report import controllers_of
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS, LOADS
from tendonrepro.results.tables import TableRows
from tendonrepro.studies.study import Site
from tendonrepro.validation.rerun import reruns
from tendonrepro.validation.residuals import comparison_rows, coupling_rows, start_rows
from tendonrepro.verdicts.from_measurement import judge_measured
from tendonrepro.verdicts.measurement import Measurement, measurement_of
from tendonrepro.verdicts.rules import Ruling

EXPECTED = (*CONTROLLERS, LOADS["with_load"], "decouple")
"""Runs that a complete measurement holds."""


@dataclass(frozen=True)
class Validation:
    """What a measurement says of paper and model.

    `rulings` are by the id of a claim or number, `models` are its reruns by run, and `residuals` compare with
    these. `starts` are errors where motions begin. `coupling` compares joint with motor angles. `controllers`
    tells what made the runs.
    """

    measurement: Measurement
    rulings: Mapping[str, Ruling]
    models: Mapping[str, Trace]
    residuals: TableRows
    starts: TableRows
    coupling: TableRows
    controllers: TableRows
    missing: Sequence[str]


def validated(file: TraceFile, name: str, base: LoadedConfig, site: Site) -> Validation:
    """Compare the measurement of a file with that `name`; motions and traces of reruns go to the site."""
    measurement = measurement_of(file, published())
    models, not_rerun = reruns(measurement, base, name, site.files, site.talk)
    timing = measurement.timing
    starts = {run: timing[run].start if run in timing else -np.inf for run in models}
    decouple = file.part("decouple").runs.get("decouple")
    return Validation(
        measurement,
        rulings=judge_measured(measurement, published()),
        models=models,
        residuals=[
            row
            for run, model in models.items()
            for row in comparison_rows(file.runs[run], model, starts[run])
        ],
        starts=[
            row
            for run, trace in measurement.compare.runs.items()
            for row in start_rows(trace, timing[run].start)
        ],
        coupling=[*coupling_rows(decouple, file.plant)] if decouple else [],
        controllers=controllers_of(measurement.compare, site.talk, site.start),
        missing=[f"the run {run}" for run in EXPECTED if run not in file.runs] + not_rerun,
    )
