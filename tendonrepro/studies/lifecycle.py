"""How every study runs: dry run, folder, resumption, numbers, tables, figures, manifest, exit code.

A study is checked before it comes here (`Study`), and knows nothing of this. Several that begin together
share processes, and draw while they write.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path

from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.files import Json
from tendonrepro.parallel import Done, Item, Start, interrupts_blocked, workers
from tendonrepro.results.store import MANIFEST, NewResult, make_manifest, refuse_others, replaced
from tendonrepro.studies.result import Result, begin_drawing
from tendonrepro.studies.study import Answer, Site, Study, cost_text

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
        result = _in_memory(study, talk)
        return Answer({**result.data, **result.beside}, str(result), result, _exit_code(result))
    (answer,) = carry_out_together([study], lambda sites: map(study.run, sites), talk)
    return answer


def carry_out_together(
    studies: Sequence[Study], run: Callable[[Sequence[Site]], Iterable[Result]], talk: Talk
) -> list[Answer[Result]]:
    """Run studies, and put their results into their folders.

    `run` finds the results of all, each at its own site, with the same processes. Errors are those of
    `carry_out`; then no folder changes.
    """
    for study in studies:
        _tell_ahead(study, talk)
    formats = [study.formats for study in studies]
    with ExitStack() as stack:
        places = [stack.enter_context(_replaced(study, talk)) for study in studies]
        start = stack.enter_context(workers())
        begin = _loading_meanwhile(start) if any(formats) else start
        made = run([Site(talk, place.path, begin) for place in places])
        results: list[Result] = []
        for study, kinds, result, place in zip(studies, formats, made, places, strict=True):
            place.manifest = _manifest(study, result, place.seconds) | {"figure_formats": list(kinds)}
            results.append(result.stamped(study.command, place.manifest))
        drawn = begin_drawing(
            [(result, place.path) for result, place in zip(results, places, strict=True)], formats[0], start
        )
        # Other processes draw meanwhile.
        for study, result, place in zip(studies, results, places, strict=True):
            result.write(place, study.numbers or study.command)
            if study.keep and not study.stays:
                shutil.rmtree(place.path / study.keep)
        for _ in drawn:
            pass
    manifests = [place.manifest for place in places]
    return [_answer(*each) for each in zip(studies, results, manifests, strict=True)]


def result_of(study: Study) -> Result:
    """Result of a study for Python: in memory, unless a folder is named or the study took long.

    In memory all is done in this process, which needs no main guard; a notebook has none.
    """
    if study.stored or study.options["out"] is not None:
        result = carry_out(study, Talk()).value
        assert result is not None
        return result
    return _in_memory(study, Talk())


def _in_memory(study: Study, talk: Talk) -> Result:
    if study.cost:
        talk.note(cost_text(study.cost))
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as files:
        result = study.run(Site(talk, Path(files)))
    return result.stamped(study.command, _manifest(study, result, time.perf_counter() - started))


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


def _answer(study: Study, result: Result, manifest: Json) -> Answer[Result]:
    """What is told of a result; tables of one without runs are read from its folder, by its manifest."""
    target = study.target
    text = f"{result}\n\nResults are in {target}"
    data = {**result.data, "out": str(target), "manifest": str(target / MANIFEST)}
    files = [str(target / file) for file in manifest["outputs"]]
    told = {**data, **result.beside, "files": files, "text": text}
    value = result
    if result.traces is None:
        value = replace(result, data=data, parts=[str(result)], manifest=manifest, folder=target)
    return Answer(told, text, value, _exit_code(result))


def _exit_code(result: Result) -> int:
    return AGAINST if result.fails_check else DIVERGED if result.diverged else 0


def _manifest(study: Study, result: Result, seconds: float) -> Json:
    """How a result came about; what only its study knows comes last."""
    known, own = make_manifest(study.loaded, seconds, study.command, study.digest), result.manifest
    return known | {"again": study.again} | dict(own) | {"config": known["config"] | own.get("config", {})}


def planned(study: Study, talk: Talk) -> dict[str, object]:
    """What ``--json`` prints of a dry run; tells what would be refused."""
    _tell_ahead(replace(study, cost={}), talk)
    _ = study.formats  # a UsageError for one that there is not
    name, digest, target = study.command, study.digest, study.target
    try:
        refuse_others(target, digest, command=name, force=study.options["force"])
    except TendonreproError as error:
        talk.note(f"a run would be refused: {error}")
    origin = study.loaded.origin if study.loaded else name
    text = f"{origin} is valid (sha256 {digest[:12]})\nwould write to {target}"
    plan = {"dry_run": True, "config_sha256": digest, "out": str(target), "text": text, **study.plan}
    if study.cost:
        plan |= {"cost": dict(study.cost), "text": f"{plan['text']}\n{cost_text(study.cost)}"}
    return {"schema_version": 1, "command": name, **plan}


def _tell_ahead(study: Study, talk: Talk) -> None:
    """Say what a user should know before a study begins: keys without effect, and how long it takes."""
    for sentence in study.loaded.remarks if study.loaded else ():
        talk.note(sentence)
    if study.cost:
        talk.note(cost_text(study.cost))
