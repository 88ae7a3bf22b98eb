"""What ``reproduce`` answers in a few lines: of the paper's arm, and of a user's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

from tendonrepro.analysis.explain import steadied_by
from tendonrepro.configuration.models.control import FIRST, SECOND
from tendonrepro.configuration.models.readings import PRINTED, STARTS_APART
from tendonrepro.configuration.published import METRICS
from tendonrepro.console import Talk, columns
from tendonrepro.errors import UsageError
from tendonrepro.experiments.run import CLOSEST
from tendonrepro.files import Json, refuse_foreign, shipped
from tendonrepro.reporting.contents import environment, read_shown
from tendonrepro.reporting.live.page import MARK, PAGE, page_beside
from tendonrepro.results.store import refuse_others
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.studies.command import COMMANDS
from tendonrepro.studies.lifecycle import carry_out
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer, Study
from tendonrepro.verdicts.words import percent

OPENED = {
    "compare/figures/fig14": "how the three controllers track",
    "compare/tables/table2.md": "their errors beside the published ones",
    "decouple/tables/table1.md": "the coupling of the joints",
}
"""What to open first below a folder of results, beside the page in a browser, and what it shows."""

OWN_FOLDER = Path("reports/own")
"""Folder above the results of a user's own arm, where none is named: the paper's own lie in ``reports``."""

AROUND: Mapping[str, object] = {"draws": 64, "spread": 0.2}
"""Arms around the user's, as `ensemble` draws them."""

TUNED: Mapping[str, object] = {"plants": 8, "spread": 0.2, "only": "ntsm,alpha_free"}
"""The two controllers that `tune` tunes, and on how many of these arms."""


def ending(results: Mapping[str, Json], live: str) -> str:
    """The answer, Table 2 beside the paper's and what to open, of what ``--json`` has of each experiment.

    `live` is the path of the page in a browser.
    """
    parts = (_paper_text(results), _table_2(results), _to_open(results, live))
    return "\n\n".join(filter(None, parts))


def _paper_text(results: Mapping[str, Json]) -> str:
    """What the runs as shipped, and the stored study, say of Controllers 1 and 2."""
    if CLOSEST not in results:
        return ""
    ours, paper = (
        table["controller_1"]["mae_deg"][0] / table["controller_2"]["mae_deg"][0]
        for table in (results["compare"]["table2"], results["compare"]["printed"]["table2"])
    )
    box = read_shown(shipped("docs/results")).box
    row, apart = box[PRINTED], percent(box[STARTS_APART]["behind"])
    share = f"{percent(row['behind'])} of {row['plants']:,.0f} stable arms"
    return "\n".join(
        (
            "Is α-TDE (Controller 1) better than TDE (Controller 2)? One run of each cannot tell.",
            f"By mean error of joint 2 Controller 1 errs {ours:.2f} times as much as Controller 2; in the "
            f"paper {paper:.2f} times.",
            f"In the stored study it errs more on {share}, with equal starts and friction;",
            f"with starts up to 2° off on {apart}. The fitted arm has such starts: that proves nothing.",
        )
    )


def _table_2(results: Mapping[str, Json]) -> str:
    """Table 2 as simulated, fitted and printed, in degrees."""
    compared = results["compare"]
    tables = {"simulated": compared["table2"]}
    tables |= {"fitted": results[CLOSEST]["table2"]} if CLOSEST in results else {}
    tables |= {"paper": compared["printed"]["table2"]} if compared.get("printed") else {}
    runs = [run for run in CONTROLLERS if run in tables["simulated"]]
    titles = [run.replace("controller_", "Controller ") for run in runs]
    rows = [["Table 2", f"joint {' / '.join(map(str, compared['joints']))}, degrees", *titles]]
    for metric in METRICS:
        for name, table in tables.items():
            sizes = (" / ".join(f"{size:.3f}" for size in table[run][f"{metric}_deg"]) for run in runs)
            rows.append([metric.upper() if name == "simulated" else "", name, *sizes])
    return columns(rows)


def _to_open(results: Mapping[str, Json], live: str) -> str:
    """Files to open; a figure as PNG if there is one."""
    files = [Path(file).as_posix() for result in results.values() for file in result["files"]]
    files.sort(key=lambda file: not file.endswith(".png"))
    rows = [["open", live, "move α, the starts or the arm in a browser"]]
    for name, about in OPENED.items():
        rows += [["", file, about] for file in files if f"/{name}" in file][:1]
    return columns(rows)


def own_studies(config: Path, above: Path, *, tune: bool, **asked: object) -> dict[str, Study]:
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
        options = {**asked, **more, "out": above / name, "config": str(source)}
        studies[name] = cast("Study", COMMANDS[name].prepare(**options))
    return studies


def answer_own(
    studies: Mapping[str, Study], out: Path, talk: Talk, *, force: bool
) -> Answer[dict[str, Result]]:
    """Carry the studies out, one after the other, and answer; what is finished stays after an interrupt.

    Arms around one whose loops are not stable are not asked. Where none can be tuned, the rest is answered.
    """
    for study in studies.values():
        refuse_others(study.target, study.digest, command=study.command, force=force)
    refuse_foreign(out / PAGE, MARK, force=force)
    loaded = studies["compare"].loaded
    assert loaded is not None
    done: dict[str, Answer[Result | None]] = {}
    told: Json = {"unstable": []}
    for name, study in studies.items():
        if name == "ensemble" and {FIRST, SECOND} & {*told["unstable"]}:
            break
        try:
            done[name] = carry_out(study, talk)
        except UsageError as error:
            if name != "tune":
                raise
            talk.note(f"not tuned: {error.message}")
            break
        if name == "explain":
            modes = cast("Json", done[name].data["runs"])
            told["unstable"] = [run for run, mode in modes.items() if not mode["stable"]]
    page = page_beside(out / PAGE, loaded, talk, force=force)
    results = {name: answer.value for name, answer in done.items() if answer.value}
    data: Json = {name: answer.data for name, answer in done.items()}
    if told["unstable"]:
        told["steadied_by"] = steadied_by(loaded)
    pairs = _pairs(data["ensemble"]) if "ensemble" in data else []
    if pairs:
        told["helps"] = helps(pairs)
    parts = [
        _own_text(data, told, pairs, results["compare"]),
        f"Results are in {out}, the arm in a browser is {page['path']}",
    ]
    whole = Result(told, parts).stamped("reproduce", results["compare"].manifest)
    tables = [answer.text for answer in done.values()] if talk.verbose else []
    return Answer(
        {"schema_version": 1, "answer": told, **data, "live": page["path"]},
        "\n\n".join([*tables, str(whole)]),
        {"answer": whole, **results},
        max(answer.exit_code for answer in done.values()),
    )


def _pairs(ensemble: Json) -> list[Json]:
    """Errors of Controller 1 over those of Controller 2 as published, a row a joint."""
    (arms,) = ensemble["populations"].values()
    asked = (FIRST, SECOND, PRINTED)
    return [row for row in arms["pairs"] if (row["run"], row["over"], row["reading"]) == asked]


def _own_text(data: Json, told: Json, pairs: Sequence[Json], compared: Result) -> str:
    """What the studies found, and what a comparison remarks of its runs, in words."""
    known = {"answer": told, "pairs": pairs, "first": FIRST, "second": SECOND}
    remarks = [part for part in compared.parts if isinstance(part, str)]
    template = environment().get_template("own_arm.md")
    return template.render(**data, **known, remarks=remarks).strip()


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
    if all(row["arms"] and row["ratio_high"] < 1.0 for row in pairs):
        return "yes"
    return "no" if all(row["arms"] and row["ratio_low"] > 1.0 for row in pairs) else "undecided"
