"""How every study runs: dry run, folder, resumption, numbers, tables, figures, manifest, exit code.

A study is checked before it comes here (`Study`), and knows nothing of this. Several that begin together
share processes, and draw while they write.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TypeVar

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.parallel import Start, interrupts_blocked, workers
from tendonrepro.results.formats import formats_of
from tendonrepro.results.store import (
    MANIFEST,
    NewResult,
    made_here,
    make_manifest,
    read_manifest,
    refuse_others,
    replaced,
)
from tendonrepro.studies.outcome import Outcome, begin_drawing, figure_formats
from tendonrepro.studies.parameters import Destination
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Site, Study

Item = TypeVar("Item")
Done = TypeVar("Done")

AGAINST = 3
"""Exit code of a check that fails."""

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
    if dry_run:
        plan = planned(name, study, talk)
        return Answer(plan, str(plan["text"]), None)
    if study.shown:
        result, outcome = _in_memory(name, study, talk)
        return Answer({**outcome.data, **outcome.beside}, outcome.text(), result, _exit_code(outcome))
    (answer,) = carry_out_together([(name, study)], lambda sites: map(study.run, sites), talk)
    return answer


def carry_out_together(
    studies: Sequence[tuple[str, Study]], run: Callable[[Sequence[Site]], Iterable[Outcome]], talk: Talk
) -> list[Answer[Result]]:
    """Run studies of commands, by name, and put their results into their folders.

    `run` finds the outcomes of all, each at its own site, with the same processes. Errors are those of
    `carry_out`; then no folder changes.
    """
    for _, study in studies:
        _tell_remarks(study, talk)
    formats = [_formats(study) for _, study in studies]
    with ExitStack() as stack:
        results = [stack.enter_context(_replaced(name, study, talk)) for name, study in studies]
        start = stack.enter_context(workers())
        begin = _loading_meanwhile(start) if any(formats) else start
        outcomes = run([Site(talk, result.path, begin) for result in results])
        made: list[tuple[Outcome, NewResult]] = []
        for (name, study), kinds, outcome, result in zip(studies, formats, outcomes, results, strict=True):
            result.manifest = manifest_of(name, study, outcome, result.seconds) | figure_formats(kinds)
            made.append((outcome.stamped(result.manifest), result))
        drawn = begin_drawing([(outcome, result.path) for outcome, result in made], formats[0], start)
        # Other processes draw meanwhile.
        for (name, study), (outcome, result) in zip(studies, made, strict=True):
            outcome.write(result, name if study.numbers == "" else study.numbers)
            if study.keep and not study.stays:
                shutil.rmtree(result.path / study.keep)
        for _ in drawn:
            pass
    return [
        _answer(name, study, outcome, result.manifest)
        for (name, study), (outcome, result) in zip(studies, made, strict=True)
    ]


def result_of(name: str, study: Study) -> Result:
    """Result of a study for Python: in memory, unless a folder is named or the study took long.

    In memory all is done in this process, which needs no main guard; a notebook has none.
    """
    if study.stored or study.options["out"] is not None:
        result = carry_out(name, study, Talk()).value
        assert result is not None
        return result
    return _in_memory(name, study, Talk())[0]


def _in_memory(name: str, study: Study, talk: Talk) -> tuple[Result, Outcome]:
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as files:
        outcome = study.run(Site(talk, Path(files)))
    manifest = manifest_of(name, study, outcome, time.perf_counter() - started)
    return Result(name, outcome.stamped(manifest), manifest), outcome


def _replaced(name: str, study: Study, talk: Talk) -> AbstractContextManager[NewResult]:
    """Folder of a study's results while they are made."""
    force, target = study.options["force"], _target(name, study)
    return replaced(target, _digest(name, study), command=name, force=force, keep=study.keep, talk=talk)


def _loading_meanwhile(start: Start) -> Start:
    """Let this process load what draws while others work."""

    def begin(function: Callable[[Item], Done], items: Sequence[Item]) -> Iterable[Done]:
        begun = start(function, items)
        # Interrupted, loading matplotlib makes Python crash.
        with interrupts_blocked():
            import tendonrepro.results.figures.catalogue  # noqa: F401 (loaded early)
        return begun

    return begin


def _answer(name: str, study: Study, outcome: Outcome, manifest: dict[str, object]) -> Answer[Result]:
    target = _target(name, study)
    text = f"{outcome.text()}\n\nResults are in {target}"
    place = {"out": str(target), "manifest": str(target / MANIFEST)}
    data = {**outcome.data, **place}
    if outcome.traces is None:
        manifest = read_manifest(target)
        value = Result(name, Outcome(data, [outcome.text()], outcome.figures), manifest, _folder=target)
    else:
        value = Result(name, outcome, manifest)
    told = {**data, **outcome.beside, "text": text}
    if study.lists_files:
        told["files"] = [str(target / file) for file in read_manifest(target)["outputs"]]
    return Answer(told, text, value, _exit_code(outcome))


def _exit_code(outcome: Outcome) -> int:
    return AGAINST if outcome.fails_check else DIVERGED if outcome.diverged else 0


def folder_of(name: str, folder: Destination) -> Path:
    """Results folder of a command, by default its own below reports."""
    out = folder.get("out")
    return Path("reports") / name if out is None else Path(out)


def _target(name: str, study: Study) -> Path:
    named = study.options["out"]
    return study.place if named is None and study.place else folder_of(name, study.options)


def _digest(name: str, study: Study) -> str:
    """Digest of what decides a study's results, the command's name where no configuration does."""
    return study.basis.sha256 if study.basis else name


def _formats(study: Study) -> tuple[str, ...]:
    return formats_of(study.options["formats"], figures=study.options["figures"])


def manifest_of(name: str, study: Study, outcome: Outcome, seconds: float) -> dict[str, object]:
    """How a result came about; what only its study knows comes last."""
    loaded = study.basis
    known = made_here(name, _digest(name, study)) if loaded is None else make_manifest(loaded, seconds, name)
    return known | dict(outcome.manifest)


def planned(name: str, study: Study, talk: Talk) -> dict[str, object]:
    """What ``--json`` prints of a dry run; tells what would be refused."""
    _tell_remarks(study, talk)
    _formats(study)
    digest, target = _digest(name, study), _target(name, study)
    try:
        refuse_others(target, digest, command=name, force=study.options["force"])
    except TendonreproError as error:
        talk.note(f"a run would be refused: {error}")
    origin = study.loaded.origin if study.loaded else name
    text = f"{origin} is valid (sha256 {digest[:12]})\nwould write to {target}"
    plan = {"dry_run": True, "config_sha256": digest, "out": str(target), "text": text}
    return {"schema_version": 1, "command": name, **plan, **study.plan}


def _tell_remarks(study: Study, talk: Talk) -> None:
    for sentence in remarks(study.loaded) if study.loaded else ():
        talk.note(sentence)


def remarks(loaded: LoadedConfig) -> Iterator[str]:
    """Name keys that change nothing, and shipped files that stand in for files that are not there."""
    yield from loaded.unread
    for path in loaded.stand_ins:
        yield f"no {path.name} in {loaded.folder}, so the shipped one is taken: {path}"
