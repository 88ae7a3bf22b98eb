"""What `reproduce` answers of a user's own arm: is it stable, who errs less, and does that hold around it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from tendonrepro.analysis.explain import steadied_by
from tendonrepro.configuration.models.control import FIRST, SECOND
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import Json, refuse_foreign
from tendonrepro.reporting.live.page import MARK, PAGE, page_beside
from tendonrepro.results.store import refuse_others
from tendonrepro.studies.command import COMMANDS
from tendonrepro.studies.lifecycle import carry_out, planned
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Study, cost_text

if TYPE_CHECKING:
    from tendonrepro.configuration.load import LoadedConfig

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
    return {
        name: _prepared(name, **{**asked, **more, "out": above / name, "config": str(source)})
        for name, (source, more) in own.items()
    }


def _prepared(name: str, **given: object) -> Study:
    """The study of a command, as a user of Python would ask for it."""
    command = COMMANDS[name]
    return cast("Study", command.prepare(**command.bound(**given).arguments))


def own_plan(studies: Studies, talk: Talk) -> Answer[dict[str, Result]]:
    """What would be run, and how long it takes."""
    plans = {name: planned(study, talk) for name, study in studies.items()}
    text = [*(str(plan["text"]) for plan in plans.values()), _ahead(studies)]
    return Answer({"schema_version": 1, **plans, "cost": _cost(studies)}, "\n\n".join(text), {})


def _cost(studies: Studies) -> dict[str, float]:
    """Cost of those that are long enough to have one."""
    known = [study.cost for study in studies.values() if study.cost]
    return {name: sum(cost[name] for cost in known) for name in ("experiments", "processor_hours")}


def _ahead(studies: Studies) -> str:
    """What is to come, and how long it takes."""
    return f"{', '.join(studies)}: some seconds each, and {cost_text(_cost(studies))}"


def answer_own(studies: Studies, out: Path, talk: Talk, *, force: bool) -> Answer[dict[str, Result]]:
    """Carry the studies out, one after the other, and answer; what is finished stays after an interrupt.

    Arms around one whose loops are not stable are not asked.
    """
    for study in studies.values():
        refuse_others(study.target, study.digest, command=study.command, force=force)
    refuse_foreign(out / PAGE, MARK, force=force)
    talk.note(_ahead(studies))
    done: dict[str, Answer[Result | None]] = {}
    told: Json = {}
    for name, study in studies.items():
        if name == "ensemble" and {FIRST, SECOND} & {*told["unstable"]}:
            break
        try:
            done[name] = carry_out(study, talk)
        except UsageError as error:
            if name != "tune":
                raise
            told["tuned"] = {"refused": error.message}
            continue
        told |= _found(name, done[name].data, comparison(studies))
        if name == "compare" and (result := done[name].value):
            told["remarks"] = [part for part in result.parts if isinstance(part, str)]
    page = page_beside(out / PAGE, comparison(studies), talk, force=force)
    results = {name: answer.value for name, answer in done.items() if answer.value}
    parts = [own_text(told), f"Results are in {out}, the arm in a browser is {page['path']}"]
    whole = Result(told, parts).stamped("reproduce", results["compare"].manifest)
    data = {name: part.data for name, part in done.items()}
    tables = [part.text for part in done.values()] if talk.verbose else []
    return Answer(
        {"schema_version": 1, "answer": told, **data, "live": page["path"]},
        "\n\n".join([*tables, str(whole)]),
        {"answer": whole, **results},
        max(part.exit_code for part in done.values()),
    )


def comparison(studies: Studies) -> LoadedConfig:
    """The configuration of the comparison."""
    loaded = studies["compare"].loaded
    assert loaded is not None
    return loaded


def _found(name: str, data: Mapping[str, Any], loaded: LoadedConfig) -> Json:
    """What a study says of the question."""
    if name == "explain":
        runs = data["runs"]
        unstable = [run for run, modes in runs.items() if not modes["stable"]]
        stability: Json = {
            "unstable": unstable,
            "decay": {run: modes["decay"] for run, modes in runs.items()},
            "joints": data["joints"],
        }
        return stability | ({"steadied_by": steadied_by(loaded)} if unstable else {})
    if name == "compare":
        sizes = {run: data["table2"][run]["mae_deg"] for run in (FIRST, SECOND)}
        status = {run: data["status"][run] for run in (FIRST, SECOND)}
        return {"compared": {"mae_deg": sizes, "status": status}}
    if name == "ensemble":
        (arms,) = data["populations"].values()
        pairs = [row for row in arms["pairs"] if (row["run"], row["over"]) == (FIRST, SECOND)]
        own = [row for row in pairs if row["reading"] == PRINTED]
        around = {"told": data["around"]["told"], "arms": arms["plants"], "pairs": own}
        return {"around": around, "helps": helps(own)}
    if name == "tune":
        (question,) = data["questions"]
        alphas = [row for row in data["alpha"] if not row["alone"]]
        return {"tuned": {"plants": data["plants"], **question, "alpha": alphas}}
    return {}


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


HELPS = {
    "yes": "Yes: it errs less than TDE on nearly all arms around yours",
    "no": "No: it errs more than TDE on nearly all arms around yours",
    "undecided": "Undecided: that depends on the arm or the joint",
}


def own_text(told: Json) -> str:
    """The answer in words, α-TDE being Controller 1 and TDE Controller 2."""
    return "\n".join(
        [
            *_helps_text(told),
            *_stable_text(told),
            *_compared_text(told),
            *_around_text(told),
            *_tuned_text(told),
        ]
    )


def _helps_text(told: Json) -> Iterator[str]:
    if "helps" in told:
        yield (
            f"Does α-TDE help? {HELPS[told['helps']]}, with your gains, equal friction, and runs that "
            "start as in your file."
        )


def _stable_text(told: Json) -> Iterator[str]:
    if not told["unstable"]:
        slowest = min(told["decay"].values())
        yield f"Stable: yes, every loop, linearised; the slowest mode decays by {slowest:.3g} a second."
        return
    yield f"Stable: no, {', '.join(told['unstable'])} {'grow' if told['unstable'][1:] else 'grows'}."
    ways = [f"{key} {factor:g} times yours" for key, factor in told["steadied_by"].items() if factor]
    yield (
        f"All are with {', or with '.join(ways)}."
        if ways
        else "Neither another control.gains.M_bar nor more damping of the tendons is enough alone."
    )
    if "around" not in told:
        yield "Arms around it are not asked until then."


def _compared_text(told: Json) -> Iterator[str]:
    sizes, status = told["compared"]["mae_deg"], told["compared"]["status"]
    if any(word != "ok" for word in status.values()):
        ends = ", ".join(f"{run} is {word}" for run, word in status.items())
        near = (
            ""
            if told["unstable"]
            else " Stable loops that do so are near their limit: give them more margin."
        )
        yield f"Compared: {ends} in the run.{near}"
        return
    yield "Compared, mean error of α-TDE (Controller 1) and of TDE (Controller 2):"
    for joint, first, second in zip(told["joints"], sizes[FIRST], sizes[SECOND], strict=True):
        yield f"  joint {joint}: {first:.3f} and {second:.3f} degrees, {first / second:.2f} times"
    yield from told["remarks"]


def _around_text(told: Json) -> Iterator[str]:
    if "around" not in told:
        return
    around = told["around"]
    yield f"On {around['arms']} arms {around['told']}: median, and where the central 90 % of them lie:"
    for row in around["pairs"]:
        if not row["arms"]:
            yield f"  joint {row['joint']}: on none are both stable"
            continue
        less = round(row["share_smaller"] * row["arms"])
        yield (
            f"  joint {row['joint']}: α-TDE errs {row['ratio']:.2f} times TDE, {row['ratio_low']:.2f} to "
            f"{row['ratio_high']:.2f}; both are stable on {row['arms']} of {around['arms']}, "
            f"it errs less on {less}"
        )


def _tuned_text(told: Json) -> Iterator[str]:
    tuned = told.get("tuned")
    if not tuned:
        return
    if "refused" in tuned:
        yield f"Tuned: not, {tuned['refused']}."
        return
    names = ("smaller_error", "larger_error", "no_difference", "undecided")
    counts = [tuned[name] for name in names]
    less, more, alike, undecided = counts
    yield (
        f"Tuned on {tuned['plants']} of them, α free: of {sum(counts)} conditions α-TDE errs less under "
        f"{less}, more under {more}, alike under {alike}; {undecided} are undecided."
    )
    for row in tuned["alpha"]:
        yield (
            f"  {row['condition']}: the best α is {row['alpha_median']:.2g}, the median of {row['cases']} "
            f"searches; in {row['share_without_effect']:.0%} of them α changes nothing"
        )
