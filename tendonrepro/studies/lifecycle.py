"""How every study runs: dry run, folder, resumption, numbers, tables, figures, manifest, exit code.

A study is checked before it comes here (`Study`), and knows nothing of this.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.results.formats import formats_of
from tendonrepro.results.store import MANIFEST, make_manifest, read_manifest, refuse_others, replaced
from tendonrepro.studies.outcome import Outcome, figure_formats
from tendonrepro.studies.parameters import Place
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Study

DIVERGED = 5
"""Exit code where a run diverged; its results are written."""


def carry_out(name: str, study: Study, talk: Talk, *, dry_run: bool = False) -> Answer[Result | None]:
    """Run the study of a command, and put its results into their folder.

    Raises
    ------
    UsageError
        If the folder holds other results, or another process writes there.
    TendonreproError
        As the study itself, or if the folder cannot be written. Finished parts are kept.
    """
    target, options = folder_of(name, study.folder), study.options
    formats = formats_of(options["formats"], figures=options["figures"])
    for sentence in study.loaded.unread:
        talk.note(sentence)
    if dry_run:
        plan = planned(name, study.loaded, target, talk, force=options["force"])
        plan |= study.plan
        return Answer(plan, plan["text"], None)
    digest, keep = study.loaded.sha256, study.keep
    with replaced(target, digest, command=name, force=options["force"], keep=keep, talk=talk) as result:
        outcome = study.run(talk, result.path)
        outcome.save(result, study.numbers or name, formats)
        if keep and not study.stays:
            shutil.rmtree(result.path / keep)
        result.manifest = manifest_of(name, study.loaded, outcome, result.seconds) | figure_formats(formats)
    data = {**outcome.data, "out": str(target), "manifest": str(target / MANIFEST)}
    text = f"{outcome.text()}\n\nResults are in {target}"
    value = Result(name, Outcome(data, [outcome.text()]), read_manifest(target), _folder=target)
    return Answer({**data, "text": text}, text, value, DIVERGED if outcome.data.get("diverged") else 0)


def result_of(name: str, study: Study, talk: Talk | None = None) -> Result:
    """Result of a study for Python: in memory, unless a folder is named or the study took long."""
    talk = talk or Talk()
    if study.stored or study.options["out"] is not None:
        result = carry_out(name, study, talk).value
        assert result is not None
        return result
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as files:
        outcome = study.run(talk, Path(files))
    return Result(name, outcome, manifest_of(name, study.loaded, outcome, time.perf_counter() - started))


def folder_of(name: str, folder: Place) -> Path:
    """Results folder of a command, by default its own below reports."""
    out = folder.get("out")
    return Path("reports") / name if out is None else Path(out)


def manifest_of(name: str, loaded: LoadedConfig, outcome: Outcome, seconds: float) -> dict[str, Any]:
    """How a result came about; what only its study knows comes last."""
    return make_manifest(loaded, seconds, name) | dict(outcome.manifest)


def planned(name: str, loaded: LoadedConfig, target: Path, talk: Talk, *, force: bool) -> dict[str, Any]:
    """What ``--json`` prints of a dry run; tells what would be refused."""
    try:
        refuse_others(target, loaded.sha256, command=name, force=force)
    except TendonreproError as error:
        talk.note(f"a run would be refused: {error}")
    text = f"{loaded.origin} is valid (sha256 {loaded.sha256[:12]})\nwould write to {target}"
    plan = {"dry_run": True, "config_sha256": loaded.sha256, "out": str(target), "text": text}
    return {"schema_version": 1, "command": name, **plan}
