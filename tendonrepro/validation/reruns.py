"""Both experiments of a measurement run again by the model, and what could not be run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from tendonrepro.claims.from_measurement import Measured
from tendonrepro.config.load import LoadedConfig, load_config
from tendonrepro.config.published import COMPARED
from tendonrepro.console import Talk
from tendonrepro.dataset.motion.recover import Reference, zero_of
from tendonrepro.errors import TendonreproError
from tendonrepro.files import write_atomically
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.validation.rerun import (
    COMPARE,
    DECOUPLE,
    aligned,
    departure,
    rerun,
    write_compare,
    write_decouple,
)


@dataclass
class Work:
    """What has been done of a validation.

    Parameters
    ----------
    folder : Path
        Results folder.
    files : list of Path
        Written so far.
    simulated : list of TraceFile
        Reruns, one file an experiment.
    zeros : dict
        Run -> measured time at which its rerun begins, s.
    missing : list of str
        What could not be done, and why.
    """

    folder: Path
    files: list[Path] = field(default_factory=list)
    simulated: list[TraceFile] = field(default_factory=list)
    zeros: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)

    def write(self, name: str, text: str) -> None:
        """Write a text file of the result."""
        write_atomically(self.folder / name, text)
        self.files.append(self.folder / name)

    def runs(self, measured: TraceFile) -> dict[str, Trace]:
        """Simulated runs by name, on the measured axes."""
        return {
            name: aligned(trace, measured.runs[name], self.zeros[name])
            for file in self.simulated
            for name, trace in file.runs.items()
        }


def rerun_compare(
    measured: Measured,
    reference: Reference | None,
    name: str,
    base: LoadedConfig,
    work: Work,
    talk: Talk,
) -> None:
    """Rerun the comparison on the recovered motion, all runs that followed it.

    Parameters
    ----------
    measured : Measured
    reference : Reference or None
        The motion as a configuration can hold it.
    name : str
        Of the measured file.
    base : LoadedConfig
        The model.
    work : Work
        Takes the files, the runs, and what is missing.
    talk : Talk
    """
    reason, runs = measured.unrecovered, measured.compare.runs
    if reference is not None and reference.record.joint != COMPARED:
        reason = "no run holds the desired angles q_d of both joints 2 and 3"
    if reference is None or reason:
        work.missing.append(f"a rerun of the comparison: {reason}")
        return
    apart = {run: math.degrees(departure(trace, reference)) for run, trace in runs.items()}
    work.missing += [
        f"residuals of {run}: its desired motion differs from that of {reference.run} by up to {size:.3g} deg"
        for run, size in apart.items()
        if size
    ]
    try:
        masses = {run: float(trace.attributes["payload_mass"]) for run, trace in runs.items()}
        work.files += write_compare(base, reference, masses, name, work.folder)
        simulated = rerun(work.folder / COMPARE, [run for run in runs if not apart[run]], talk)
    except TendonreproError as error:
        work.missing.append(f"a rerun of the comparison: {_with_hint(error)}")
        return
    if simulated.runs:
        work.simulated.append(simulated)
        work.zeros |= {run: zero_of(runs[run], reference) for run in simulated.runs}


def _with_hint(error: TendonreproError) -> str:
    return f"{error.message}; {error.hint}" if error.hint else error.message


def rerun_decouple(trace: Trace, name: str, base: LoadedConfig, work: Work, talk: Talk) -> None:
    """Rerun the decoupling run on the motors measured in it; parameters as of `rerun_compare`."""
    if trace.joint != (1, 2, 3):
        work.missing.append("all of joints 1 to 3 in the run decouple: no rerun of it")
        return
    try:
        work.files += write_decouple(_decouple_config(base), trace, name, work.folder)
        work.simulated.append(rerun(work.folder / DECOUPLE, [trace.name], talk))
    except TendonreproError as error:
        work.missing.append(f"a rerun of the run decouple: {_with_hint(error)}")
        return
    work.zeros[trace.name] = float(trace.time[0])


def _decouple_config(base: LoadedConfig) -> LoadedConfig:
    """The configuration given, or the shipped one with what was set of the manipulator."""
    if base.config.experiment == "decouple":
        return base
    both = [text for text in base.overrides if text.startswith(("manipulator.", "seed="))]
    return load_config(None, "decouple", overrides=both)
