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
from tendonrepro.configuration.quantity import unusual
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.files import Json
from tendonrepro.parallel import Start, interrupts_blocked, workers
from tendonrepro.results.store import MANIFEST, NewResult, make_manifest, refuse_others, replaced
from tendonrepro.studies.outcome import Outcome, begin_drawing, figure_formats
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Site, Study

Item = TypeVar("Item")
Done = TypeVar("Done")

AGAINST = 3
"""Exit code of a check that fails."""

DIVERGED = 5
"""Exit code where a run diverged; its results are written."""


def carry_out(study: Study, talk: Talk, *, dry_run: bool = False) -> Answer[Result | None]:
    """Run a study, and put its results into their folder.

    Raises
    ------
    UsageError
        If the folder holds other results, or another process writes there.
    TendonreproError
        As the study itself, or if the folder cannot be written. Finished parts are kept.
    """
    if dry_run:
        plan = planned(study, talk)
        return Answer(plan, str(plan["text"]), None)
    if study.shown:
        result, outcome = _in_memory(study, talk)
        return Answer({**outcome.data, **outcome.beside}, outcome.text(), result, _exit_code(outcome))
    (answer,) = carry_out_together([study], lambda sites: map(study.run, sites), talk)
    return answer


def carry_out_together(
    studies: Sequence[Study], run: Callable[[Sequence[Site]], Iterable[Outcome]], talk: Talk
) -> list[Answer[Result]]:
    """Run studies, and put their results into their folders.

    `run` finds the outcomes of all, each at its own site, with the same processes. Errors are those of
    `carry_out`; then no folder changes.
    """
    for study in studies:
        _tell_remarks(study, talk)
    formats = [study.formats for study in studies]
    with ExitStack() as stack:
        results = [stack.enter_context(_replaced(study, talk)) for study in studies]
        start = stack.enter_context(workers())
        begin = _loading_meanwhile(start) if any(formats) else start
        made = run([Site(talk, result.path, begin) for result in results])
        outcomes: list[Outcome] = []
        for study, kinds, outcome, result in zip(studies, formats, made, results, strict=True):
            result.manifest = _manifest(study, outcome, result.seconds) | figure_formats(kinds)
            outcomes.append(outcome.stamped(result.manifest))
        folders = [result.path for result in results]
        drawn = begin_drawing([*zip(outcomes, folders, strict=True)], formats[0], start)
        # Other processes draw meanwhile.
        for study, outcome, result in zip(studies, outcomes, results, strict=True):
            outcome.write(result, study.command if study.numbers == "" else study.numbers)
            if study.keep and not study.stays:
                shutil.rmtree(result.path / study.keep)
        for _ in drawn:
            pass
    return [_answer(*each) for each in zip(studies, outcomes, results, strict=True)]


def result_of(study: Study) -> Result:
    """Result of a study for Python: in memory, unless a folder is named or the study took long.

    In memory all is done in this process, which needs no main guard; a notebook has none.
    """
    if study.stored or study.options["out"] is not None:
        result = carry_out(study, Talk()).value
        assert result is not None
        return result
    return _in_memory(study, Talk())[0]


def _in_memory(study: Study, talk: Talk) -> tuple[Result, Outcome]:
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as files:
        outcome = study.run(Site(talk, Path(files)))
    manifest = _manifest(study, outcome, time.perf_counter() - started)
    return Result(study.command, outcome.stamped(manifest), manifest), outcome


def _replaced(study: Study, talk: Talk) -> AbstractContextManager[NewResult]:
    """Folder of a study's results while they are made."""
    force = study.options["force"]
    return replaced(
        study.target, study.digest, command=study.command, force=force, keep=study.keep, talk=talk
    )


def _loading_meanwhile(start: Start) -> Start:
    """Let this process load what draws while others work."""

    def begin(function: Callable[[Item], Done], items: Sequence[Item]) -> Iterable[Done]:
        begun = start(function, items)
        # Interrupted, loading matplotlib makes Python crash.
        with interrupts_blocked():
            import tendonrepro.results.figures.catalogue  # noqa: F401 (loaded early)
        return begun

    return begin


def _answer(study: Study, outcome: Outcome, result: NewResult) -> Answer[Result]:
    target = study.target
    text = f"{outcome.text()}\n\nResults are in {target}"
    data = {**outcome.data, "out": str(target), "manifest": str(target / MANIFEST)}
    if outcome.traces is None:
        shown = Outcome(data, [outcome.text()], outcome.figures)
        value = Result(study.command, shown, result.manifest, _folder=target)
    else:
        value = Result(study.command, outcome, outcome.traces.manifest)
    told = {**data, **outcome.beside, "text": text}
    if study.lists_files:
        told["files"] = [str(target / file) for file in result.manifest["outputs"]]
    return Answer(told, text, value, _exit_code(outcome))


def _exit_code(outcome: Outcome) -> int:
    return AGAINST if outcome.fails_check else DIVERGED if outcome.diverged else 0


def _manifest(study: Study, outcome: Outcome, seconds: float) -> Json:
    """How a result came about; what only its study knows comes last."""
    known, own = make_manifest(study.loaded, seconds, study.command, study.digest), outcome.manifest
    return known | {"again": study.again} | dict(own) | {"config": known["config"] | own.get("config", {})}


def planned(study: Study, talk: Talk) -> dict[str, object]:
    """What ``--json`` prints of a dry run; tells what would be refused."""
    _tell_remarks(study, talk)
    _ = study.formats  # a UsageError for one that there is not
    name, digest, target = study.command, study.digest, study.target
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
    """Name keys that change nothing or are unusual, and shipped files that stand in for absent ones."""
    yield from loaded.unread
    yield from unusual(loaded.config)
    for path in loaded.stand_ins:
        yield f"no {path.name} in {loaded.folder}, so the shipped one is taken: {path}"
