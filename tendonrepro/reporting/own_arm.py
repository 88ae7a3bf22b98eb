"""What `reproduce` answers of a user's own arm: is it stable, who errs less, and does that hold around it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias, cast

from tendonrepro.analysis.explain import steadied_by
from tendonrepro.configuration.models.control import FIRST, SECOND
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import Json, refuse_foreign
from tendonrepro.reporting.live.page import MARK, PAGE, page_beside
from tendonrepro.results.store import refuse_others
from tendonrepro.studies.command import COMMANDS
from tendonrepro.studies.lifecycle import carry_out
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Study

FOLDER = Path("reports/own")
"""Folder above the results, where none is named: the paper's own lie in ``reports``."""

AROUND: Mapping[str, object] = {"draws": 64, "spread": 0.2}
"""Arms around the user's, as `ensemble` draws them."""

TUNED: Mapping[str, object] = {"plants": 8, "spread": 0.2, "only": "ntsm,alpha_free"}
"""The two controllers that `tune` tunes, and on how many of these arms."""

Studies: TypeAlias = Mapping[str, Study]


def own_studies(config: Path, above: Path, *, tune: bool, **asked: object) -> Studies:
    """Check and prepare the studies of a comparison, in the order in which they answer.

    `config` may be the folder of ``compare.yaml`` and ``decouple.yaml``; `asked` has the options of all.

    Raises
    ------
    UsageError
        For standard input, which can be read only once.
    ConfigError
        If it is no comparison of the three controllers, or cannot be used.
    """
    if str(config) == "-":
        message = "several studies read the comparison, so it must be a file"
        raise UsageError(message, where="--config", hint="name the file, as mine/compare.yaml")
    file = config / "compare.yaml" if config.is_dir() else config
    own: dict[str, tuple[Path, Mapping[str, object]]] = {"explain": (file, {}), "compare": (file, {})}
    if config.is_dir():
        own["decouple"] = (config / "decouple.yaml", {})
    own["ensemble"] = (file, AROUND)
    if tune:
        own["tune"] = (file, TUNED)
    studies: dict[str, Study] = {}
    for name, (source, more) in own.items():
        command = COMMANDS[name]
        options = {**asked, **more, "out": above / name, "config": str(source)}
        studies[name] = cast("Study", command.prepare(**command.bound(**options).arguments))
    return studies


def answer_own(studies: Studies, out: Path, talk: Talk, *, force: bool) -> Answer[dict[str, Result]]:
    """Carry the studies out, one after the other, and answer; what is finished stays after an interrupt.

    Arms around one whose loops are not stable are not asked. Where none can be tuned, the rest is answered.
    """
    for study in studies.values():
        refuse_others(study.target, study.digest, command=study.command, force=force)
    refuse_foreign(out / PAGE, MARK, force=force)
    loaded = studies["compare"].loaded
    assert loaded is not None
    done: dict[str, Answer[Result | None]] = {}
    data: Json = {}
    for name, study in studies.items():
        if name == "ensemble" and {FIRST, SECOND} & {*_unstable(data)}:
            break
        try:
            done[name] = carry_out(study, talk)
        except UsageError as error:
            if name != "tune":
                raise
            talk.note(f"not tuned: {error.message}")
            break
        data[name] = {**done[name].data}
    page = page_beside(out / PAGE, loaded, talk, force=force)
    results = {name: answer.value for name, answer in done.items() if answer.value}
    told: Json = {"unstable": _unstable(data)}
    if told["unstable"]:
        told["steadied_by"] = steadied_by(loaded)
    lines = [*_stable_text(data, told), *_compared_text(data, results["compare"])]
    if "ensemble" in data:
        pairs = _pairs(data)
        told["helps"] = helps(pairs)
        lines = [HELPS[told["helps"]], *lines, *_around_text(data["ensemble"], pairs)]
    if "tune" in data:
        lines += _tuned_text(data["tune"])
    parts = ["\n".join(lines), f"Results are in {out}, the arm in a browser is {page['path']}"]
    whole = Result(told, parts).stamped("reproduce", results["compare"].manifest)
    tables = [part.text for part in done.values()] if talk.verbose else []
    return Answer(
        {"schema_version": 1, "answer": told, **data, "live": page["path"]},
        "\n\n".join([*tables, str(whole)]),
        {"answer": whole, **results},
        max(part.exit_code for part in done.values()),
    )


def _unstable(data: Json) -> list[str]:
    return [run for run, modes in data["explain"]["runs"].items() if not modes["stable"]]


def _pairs(data: Json) -> list[Json]:
    """Errors of Controller 1 over those of Controller 2 as published, a row a joint."""
    (arms,) = data["ensemble"]["populations"].values()
    asked = (FIRST, SECOND, PRINTED)
    return [row for row in arms["pairs"] if (row["run"], row["over"], row["reading"]) == asked]


def helps(pairs: Sequence[Mapping[str, float]]) -> str:
    """Whether α-TDE errs less than TDE around an arm.

    Parameters
    ----------
    pairs : sequence of mapping
        Of Controller 1 over Controller 2, one a joint: ``arms`` on which both are stable, and
        ``ratio_low`` and ``ratio_high``, between which lie 90 % of the ratios of their errors.

    Returns
    -------
    {'yes', 'no', 'undecided'}
        The first two where the central 90 % lie on one side of 1 on every joint.
    """
    if any(not row["arms"] for row in pairs):
        return "undecided"
    if all(row["ratio_high"] < 1.0 for row in pairs):
        return "yes"
    return "no" if all(row["ratio_low"] > 1.0 for row in pairs) else "undecided"


_ASKED = "with your gains, equal friction, and runs that start as in your file."
HELPS = {
    "yes": f"Does α-TDE help? Yes: it errs less than TDE on nearly all arms around yours, {_ASKED}",
    "no": f"Does α-TDE help? No: it errs more than TDE on nearly all arms around yours, {_ASKED}",
    "undecided": f"Does α-TDE help? Undecided: that depends on the arm or the joint, {_ASKED}",
}
"""The answer in words, α-TDE being Controller 1 and TDE Controller 2."""


def _stable_text(data: Json, told: Json) -> Iterator[str]:
    if not told["unstable"]:
        slowest = min(modes["decay"] for modes in data["explain"]["runs"].values())
        yield f"Stable: yes, every loop, linearised; the slowest mode decays by {slowest:.3g} a second."
        return
    yield f"Stable: no, unstable are {', '.join(told['unstable'])}."
    ways = [f"{key} {factor:g} times yours" for key, factor in told["steadied_by"].items() if factor]
    if ways:
        yield f"All are stable with {', or with '.join(ways)}."
    else:
        yield "Neither another control.gains.M_bar nor more damping of the tendons is enough alone."
    if "ensemble" not in data:
        yield "Arms around it are not asked until then."


def _compared_text(data: Json, result: Result) -> Iterator[str]:
    compared = data["compare"]
    status = {run: compared["status"][run] for run in (FIRST, SECOND)}
    if any(word != "ok" for word in status.values()):
        ends = ", ".join(f"{run} is {word}" for run, word in status.items())
        near = "; a stable loop that does so is near its limit: give it more margin" * (not _unstable(data))
        yield f"Compared: {ends} in the run{near}."
        return
    yield "Compared, mean error of α-TDE (Controller 1) and of TDE (Controller 2):"
    sizes = (compared["table2"][run]["mae_deg"] for run in status)
    for joint, first, second in zip(compared["joints"], *sizes, strict=True):
        yield f"  joint {joint}: {first:.3f} and {second:.3f} degrees, {first / second:.2f} times"
    # What a comparison remarks of its runs.
    yield from (part for part in result.parts if isinstance(part, str))


def _around_text(ensemble: Json, pairs: Sequence[Json]) -> Iterator[str]:
    (population,) = ensemble["populations"].values()
    arms = population["plants"]
    yield f"On {arms} arms {ensemble['around']['told']}: median, and where the central 90 % of them lie:"
    for row in pairs:
        if not row["arms"]:
            yield f"  joint {row['joint']}: on none are both stable"
            continue
        less = round(row["share_smaller"] * row["arms"])
        yield (
            f"  joint {row['joint']}: α-TDE errs {row['ratio']:.2f} times TDE, {row['ratio_low']:.2f} to "
            f"{row['ratio_high']:.2f}; both are stable on {row['arms']} of {arms}, it errs less on {less}"
        )


def _tuned_text(tuned: Json) -> Iterator[str]:
    (question,) = tuned["questions"]
    counts = [question[name] for name in ("smaller_error", "larger_error", "no_difference", "undecided")]
    less, more, alike, undecided = counts
    yield (
        f"Tuned on {tuned['plants']} of them, α free: of {sum(counts)} conditions α-TDE errs less under "
        f"{less}, more under {more}, alike under {alike}; {undecided} are undecided."
    )
    for row in tuned["alpha"]:
        if not row["alone"]:
            yield (
                f"  {row['condition']}: the best α is {row['alpha_median']:.2g}, the median of "
                f"{row['cases']} searches; in {row['share_without_effect']:.0%} of them α changes nothing"
            )
