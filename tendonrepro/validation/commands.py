"""The command that lays a measurement beside print and model."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Unpack

from tendonrepro.studies.command import DATA, Example, study
from tendonrepro.studies.study import ARGUMENT, MEASURED_FILE, Changes, ConfigOption, Folder, Seed, Study

__all__ = ["validate"]


@study(DATA, Example("data/measured.h5"))
def validate(
    measured: Annotated[Path | str, ARGUMENT] = MEASURED_FILE,
    config: ConfigOption = None,
    *,
    set: Changes = None,
    seed: Seed = None,
    **folder: Unpack[Folder],
) -> Study:
    """Compare measured data with the paper and with the model.

    The configuration is the model's, without its reference. Changes of the manipulator hold for both
    experiments.

    Parameters
    ----------
    measured
        Trace file written by ingest.
    """
    from tendonrepro.configuration.load import ExperimentName, load_config
    from tendonrepro.files import sha256_of
    from tendonrepro.validation.report import validation_result
    from tendonrepro.validation.validated import validated
    from tendonrepro.verdicts.measurement import read_measured

    path = Path(measured)
    file = read_measured(path)
    experiment: ExperimentName = "compare" if file.part("compare").runs else "decouple"
    base = load_config(config, experiment, overrides=set, seed=seed)
    base = replace(base, inputs=(*base.inputs, path))

    return Study(
        base,
        lambda site: validation_result(validated(file, path.name, base, site), path),
        folder,
        decided_by={"measured": sha256_of(path)},
        stored=True,
    )
