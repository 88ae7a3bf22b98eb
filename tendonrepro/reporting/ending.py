"""What ``reproduce`` says at its end: the answer, Table 2 beside the paper's, and what to open."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS
from tendonrepro.configuration.shown import STARTS_APART
from tendonrepro.console import columns
from tendonrepro.experiments.run import CLOSEST
from tendonrepro.files import Json, shipped
from tendonrepro.reporting.readings import read_shown
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.words import percent

OPENED = {
    "compare/figures/fig14": "how the three controllers track",
    "compare/tables/table2.md": "their errors beside the published ones",
    "decouple/tables/table1.md": "the coupling of the joints",
}
"""What to open first below a folder of results, beside the page in a browser, and what it shows."""


def ending(results: Mapping[str, Mapping[str, object]], live: str) -> str:
    """Text of the terminal, from what ``--json`` has of each experiment, and the path of the page `live`."""
    data: dict[str, Json] = {name: {**result} for name, result in results.items()}
    return "\n\n".join(filter(None, (_answer(data), _table_2(data), _to_open(data, live))))


def _answer(data: Mapping[str, Json]) -> str:
    """What the runs as shipped, and the stored study, say of Controllers 1 and 2."""
    if CLOSEST not in data:
        return ""
    ours, paper = (
        table["controller_1"]["mae_deg"][0] / table["controller_2"]["mae_deg"][0]
        for table in (data["compare"]["table2"], data["compare"]["printed"]["table2"])
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


def _table_2(data: Mapping[str, Json]) -> str:
    """Table 2 as simulated, fitted and printed, in degrees."""
    tables = {"simulated": data["compare"]["table2"]}
    tables |= {"fitted": data[CLOSEST]["table2"]} if CLOSEST in data else {}
    tables |= {"paper": data["compare"]["printed"]["table2"]} if data["compare"].get("printed") else {}
    runs = [run for run in CONTROLLERS if run in tables["simulated"]]
    joints = " / ".join(map(str, data["compare"]["joints"]))
    titles = [run.replace("controller_", "Controller ") for run in runs]
    rows = [["Table 2", f"joint {joints}, degrees", *titles]]
    for metric in METRICS:
        for name, table in tables.items():
            sizes = (" / ".join(f"{size:.3f}" for size in table[run][f"{metric}_deg"]) for run in runs)
            rows.append([metric.upper() if name == "simulated" else "", name, *sizes])
    return columns(rows)


def _to_open(data: Mapping[str, Json], live: str) -> str:
    """Files to open; a figure as PNG if there is one."""
    files = [Path(file).as_posix() for result in data.values() for file in result["files"]]
    files.sort(key=lambda file: not file.endswith(".png"))
    rows = [["open", live, "move α, the starts or the arm in a browser"]]
    for name, about in OPENED.items():
        rows += [["", file, about] for file in files if f"/{name}" in file][:1]
    return columns(rows)
