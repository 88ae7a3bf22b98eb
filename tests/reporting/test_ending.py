"""What reproduce says at its end: few lines, and their numbers."""

from __future__ import annotations

from typing import Any

import pytest
from support.command import run

from tendonrepro.configuration.published import published
from tendonrepro.files import shipped
from tendonrepro.reporting.ending import ending
from tendonrepro.reporting.readings import read_shown
from tendonrepro.verdicts.words import percent

RUNS = ("controller_1", "controller_2", "controller_3")


def comparison(size: float, **more: Any) -> dict[str, Any]:
    table = {run: {"mae_deg": [size + k, 0.25], "rmse_deg": [2 * size, 0.5]} for k, run in enumerate(RUNS)}
    return {"joints": [2, 3], "status": dict.fromkeys(RUNS, "ok"), "table2": table, "files": []} | more


def printed() -> dict[str, Any]:
    def sizes(run: str, metric: str) -> list[float]:
        return [published().number(f"table2.{run}.{metric}.joint_{joint}") for joint in (2, 3)]

    return {
        "table2": {run: {f"{metric}_deg": sizes(run, metric) for metric in ("mae", "rmse")} for run in RUNS}
    }


def test_as_shipped_it_is_the_answer_table_2_and_four_files() -> None:
    files = [f"out/compare/figures/fig14.{suffix}" for suffix in ("pdf", "png")] + [
        "out/compare/tables/table2.md"
    ]
    compared = comparison(3.0, printed=printed(), files=files)
    decoupled = {"files": ["out/decouple/tables/table1.md"]}
    text = ending({"decouple": decoupled, "compare": compared, "closest": comparison(1.5)}, "out/live.html")
    assert len(text.splitlines()) <= 20
    row = read_shown(shipped("docs/results")).box["printed"]
    for number in (
        "0.75",
        "0.90",
        percent(row["behind"]),
        "3.000 / 0.250",
        "1.500 / 0.250",
        "0.261 / 0.219",
        "0.436 / 0.349",
    ):
        assert number in text
    for file in ("out/live.html", files[1], files[2], "out/decouple/tables/table1.md"):
        assert file in text
    assert files[0] not in text


def test_of_changed_runs_nothing_of_the_stored_study_is_said() -> None:
    text = ending({"compare": comparison(3.0)}, "live.html")
    assert "3.000 / 0.250" in text
    assert "%" not in text
    assert "0.261" not in text


@pytest.mark.slow
def test_all_tables_are_printed_where_verbose(tmp_path) -> None:
    words = ("reproduce", "--set", "sampling_period=2", "--no-figures")
    short, long = (run(*words, *more, cwd=tmp_path).stdout for more in ((), ("--verbose",)))
    assert "Table 3" not in short
    assert "Table 3" in long
    assert long.endswith(short)
