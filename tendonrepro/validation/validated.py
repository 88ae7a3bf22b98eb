"""A measurement beside the paper and beside the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.published import published
from tendonrepro.evidence.recover_report import controllers_of
from tendonrepro.physics.kinematics import coupling_inverse, coupling_matrix
from tendonrepro.results.paper import is_arm_of_paper, of_paper
from tendonrepro.results.records import PlantRecord, PlantValue, Trace, TraceFile
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
    tells what made the runs. Of a bench that is not the paper's nothing is judged.
    """

    of_paper: bool
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
    config = base.config
    is_papers = is_arm_of_paper(config.manipulator) and of_paper(file)
    if is_papers:
        measurement = measurement_of(file, published())
    else:
        file = with_coupling(file, config.manipulator)
        measurement = measurement_of(file, None, config.joints)
    models, not_rerun = reruns(measurement, base, name, site.files, site.talk)
    timing = measurement.timing
    starts = {run: timing[run].start if run in timing else -np.inf for run in models}
    decouple = file.part("decouple").runs.get("decouple")
    return Validation(
        is_papers,
        measurement,
        rulings=judge_measured(measurement, published()) if is_papers else {},
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
        controllers=controllers_of(measurement.compare, site.talk, site.start) if is_papers else [],
        missing=[f"the run {run}" for run in (EXPECTED if is_papers else config.runs) if run not in file.runs]
        + not_rerun,
    )


def with_coupling(file: TraceFile, arm: Manipulator) -> TraceFile:
    """A measurement with the coupling of an arm, in place of the paper's, which `ingest` takes."""
    routing = arm.routing
    S_inv = coupling_inverse(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)
    values = {
        name: PlantValue(matrix, "1", f"routing of {arm.name}", name)
        for name, matrix in (("S", coupling_matrix(S_inv)), ("S_inv", S_inv))
    }
    plant = PlantRecord(values, {"arm": arm.name})
    runs = dict(file.runs)
    for name, trace in runs.items():
        if "q_motor_encoder" in trace:
            calculated = trace["q_motor_encoder"] @ plant.matrix("S", trace.joint).T
            runs[name] = replace(trace, variables={**trace.variables, "q_calculated": calculated})
    return replace(file, runs=runs, plant=plant)
