"""Copy what an ensemble and the ledger found beside this file, and write their part of findings.md from it.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``. Every number between the
two marks in findings.md comes from ``docs/results``; a test makes the text again and compares.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
RESULTS = DOCS / "results"
PAGE = DOCS / "findings.md"
BEGIN, END = "<!-- made by generate.py: begin -->", "<!-- made by generate.py: end -->"
CLAIMS = "C1 C2 F1 C3 C4 C5 C6 P1 E1 E2 E2a E3 L1 T1 K1 K2 K2a K2b K3 K4 K5 K6 A1".split()


def main(reports: Path) -> None:
    """Take results over from a reports folder and rewrite the page."""
    RESULTS.mkdir(exist_ok=True)
    summary = json.loads((reports / "ensemble" / "summary.json").read_text(encoding="utf-8"))
    ledger = json.loads((reports / "claims" / "claims.json").read_text(encoding="utf-8"))
    if (ledger.get("ensemble") or {}).get("source") != "local":
        sys.exit("these verdicts are the shipped ones; run tendonrepro claims again, beside the ensemble")
    _store("ensemble.json", _thinned(summary))
    _store("claims.json", ledger)
    decides = json.loads((reports / "claims" / "decides.json").read_text(encoding="utf-8"))
    _store("decides.json", {name: held | {"rows": held["rows"][:5]} for name, held in decides.items()})
    closest = reports / "identify_all" / "identify.json"
    if closest.exists():
        _store("identify.json", thinned_closest(json.loads(closest.read_text(encoding="utf-8"))))
    text = PAGE.read_text(encoding="utf-8")
    start, end = text.index(BEGIN), text.index(END)
    PAGE.write_text(text[:start] + BEGIN + "\n\n" + generated() + "\n" + text[end:], encoding="utf-8")


def _thinned(summary: dict[str, Any]) -> dict[str, Any]:
    """What the page shows, and no more."""
    kept = "tendonrepro_version config_sha256 draws scramblings conclusions spot_check cost".split()
    populations = {
        name: {"plants": held["plants"], "readings": [_thin_reading(reading) for reading in held["readings"]]}
        for name, held in summary["populations"].items()
    }
    return {key: summary[key] for key in kept} | {"populations": populations}


def _thin_reading(reading: dict[str, Any]) -> dict[str, Any]:
    def ratio(key: str) -> dict[str, Any]:
        numbers = reading[key]["all_ok"]["mae"]
        return {
            joint: {name: numbers[joint][name]["value"] for name in ("q05", "median", "q95")}
            for joint in numbers
        }

    def share(key: str, plants: str) -> dict[str, Any]:
        return reading[key][plants]["mae_and_rmse"]["both"]

    return {
        "name": reading["name"],
        "ok": {run: shares["ok"]["share"] for run, shares in reading["status"].items()},
        "diverged": {run: shares["diverged"]["share"] for run, shares in reading["status"].items()},
        "in_order": share("share_c1_lt_c2_lt_c3", "all_ok"),
        "in_order_diverged_last": share("share_c1_lt_c2_lt_c3", "diverged_last"),
        "in_reverse": share("share_c3_lt_c2_lt_c1", "all_ok"),
        "first_is_best": share("share_c1_best", "all_ok"),
        "rmse_over_mae_rises": reading["share_rmse_over_mae_rises"]["both"],
        "c1_c2": ratio("ratio_c1_c2"),
        "c2_c3": ratio("ratio_c2_c3"),
        "inside": len(reading["agreement"]["inside"]),
    }


def thinned_closest(data: dict[str, Any]) -> dict[str, Any]:
    """What the page shows of `tendonrepro identify --fit all`."""
    kept = "name misfit_log misfit_by_seed seeds_agree rows_searched best_shape".split()
    readings = [{key: reading[key] for key in kept} for reading in data["readings"]]
    return {key: data[key] for key in ("fit", "window", "evaluations")} | {"readings": readings}


def _store(name: str, content: Any) -> None:
    text = json.dumps(_rounded(content), indent=1, ensure_ascii=False) + "\n"
    (RESULTS / name).write_text(text, encoding="utf-8")


def _rounded(content: Any) -> Any:
    """Six digits are more than any of these numbers is worth, and keep the file small."""
    if isinstance(content, dict):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    return float(f"{content:.6g}") if isinstance(content, float) else content


def stored(name: str) -> Any:
    """Stored results."""
    return json.loads((RESULTS / name).read_text(encoding="utf-8"))


def generated() -> str:
    """The part of findings.md that comes from stored results."""
    summary, ledger = stored("ensemble.json"), stored("claims.json")
    parts = [
        _head(summary),
        "### What the ensemble says",
        "\n".join(f"- {line}" for line in summary["conclusions"]),
        "### Reading by reading",
        _readings(summary),
        "### Claim by claim",
        _claims(ledger),
        "### Number by number",
        _numbers(ledger),
        "### Which unknowns decide",
        _decides(stored("decides.json")),
    ]
    if (RESULTS / "identify.json").exists():
        parts += ["### The closest plants", closest(stored("identify.json"))]
    return "\n\n".join(parts) + "\n"


def _head(summary: dict[str, Any]) -> str:
    box, firm = (summary["populations"][name]["plants"] for name in ("box", "firm"))
    check = summary["spot_check"]
    return (
        f"{box} plants of the box and {firm} of its firm rows, {len(summary['populations']['box']['readings'])} "
        f"readings, {summary['scramblings']} scramblings, {summary['cost']['experiments']:,} runs. "
        f"{check['experiments']} runs were repeated with the SciPy stepper; on the {check['compared']} that "
        f"ran to their end MAE and RMSE differ by at most "
        f"{_percent(check['ideal']['largest'])} with ideal encoders and {_percent(check['quantised']['largest'])} "
        f"with counts; {check['disagreements']} statuses differ. Brackets are 95 % intervals from the scramblings."
    )


def _percent(share: float | None) -> str:
    if share is None:
        return "–"
    value = 100.0 * share
    return f"{value:.0f} %" if value >= 10.0 or value == 0.0 else f"{value:.2g} %"


def _share(share: dict[str, Any]) -> str:
    if share["share"] is None:
        return "–"
    if share["low"] is None:
        return _percent(share["share"])
    return f"{_percent(share['share'])} [{_percent(share['low'])}, {_percent(share['high'])}]"


def _median(ratio: dict[str, Any]) -> str:
    values = (ratio[f"joint_{joint}"]["median"] for joint in (2, 3))
    return " / ".join("–" if value is None else f"{value:.2f}" for value in values)


def _table(heads: str, rows: Iterable[Sequence[str]]) -> str:
    """Pipe table; heads with ``|`` between."""
    names = heads.split("|")
    lines = [f"| {' | '.join(cells)} |" for cells in (names, *rows)]
    return "\n".join([lines[0], "|---" * len(names) + "|", *lines[1:]])


def _readings(summary: dict[str, Any]) -> str:
    rows = (
        (
            f"`{reading['name']}`",
            " / ".join(_percent(reading["ok"][f"controller_{k}"]) for k in (1, 2, 3)),
            str(reading["in_order"]["plants"]),
            _share(reading["in_order"]),
            _percent(reading["in_order_diverged_last"]["share"]),
            _percent(reading["first_is_best"]["share"]),
            _median(reading["c1_c2"]),
            _median(reading["c2_c3"]),
            f"{reading['inside']} of 8",
        )
        for reading in summary["populations"]["box"]["readings"]
    )
    heads = "reading|ok C1 / C2 / C3|all ok|1 < 2 < 3|diverged last|C1 best|C1/C2|C2/C3|ratios inside"
    about = (
        "All ok: plants on which all three laws are. Orders are in MAE and RMSE on both joints, over those plants, and once "
        "over all plants with a diverged law ranked last. Ratios are medians of the MAE, joint 2 / joint 3, over the plants "
        "that are all ok. Ratios inside: printed ratios within the central 90 %."
    )
    return f"{_table(heads, rows)}\n\n{about}"


def _claims(ledger: dict[str, Any]) -> str:
    entries = {entry["id"]: entry for entry in ledger["claims"]}
    rows = []
    for name in [name for name in CLAIMS if name in entries]:
        entry = entries[name]
        share, others = entry["evidence"].get("share"), entry["readings_that_change_it"]
        held = _percent(share) if isinstance(share, float | int) else "–"
        more = f" and {len(others) - 4} more" if others[4:] else ""
        shown = ", ".join(f"`{other}`" for other in others[:4]) + more
        mark = " (borderline)" if entry["borderline"] else ""
        rows.append((name, entry["printed"], f"`{entry['verdict']}`{mark}", held, shown or "–"))
    remark = (
        "`contradicted` is about the equations and not about the measurement: the paper measured hardware."
    )
    return f"{_table('claim|printed|verdict|holds on|readings that change it', rows)}\n\n{remark}"


def _numbers(ledger: dict[str, Any]) -> str:
    counts: dict[str, Counter[str]] = {}
    for entry in ledger["claims"]:
        if entry["id"] not in CLAIMS:
            counts.setdefault(entry["id"].partition(".")[0], Counter())[entry["verdict"]] += 1
    words = {
        table: ", ".join(f"{count} `{name}`" for name, count in row.items()) for table, row in counts.items()
    }
    return _table("numbers|verdicts", words.items())


def _decides(rankings: dict[str, Any]) -> str:
    rows = []
    for name, held in rankings.items():
        floor = held["noise_floor"]
        above = [row for row in held["rows"] if row["index"] > max(row["half_width"], floor)][:3]
        shown = ", ".join(f"`{row['name']}` {_percent(row['index'])}" for row in above)
        what = f"C1/C2, {name.removeprefix('ratio_').replace('_', ' ')}" if name.startswith("ratio") else name
        rows.append((what, shown or "none above chance", _percent(held["unexplained"])))
    return _table("of|share of the variance that an unknown explains alone|no single one explains", rows)


def closest(data: dict[str, Any]) -> str:
    """Best plant under each reading, the best reading first."""
    rows = []
    for reading in sorted(data["readings"], key=lambda held: held["misfit_log"]):
        shapes = reading["best_shape"]
        rows.append(
            (
                f"`{reading['name']}`",
                f"{reading['misfit_log']:.3f}",
                "yes" if reading["seeds_agree"] else f"no, up to {max(reading['misfit_by_seed']):.3f}",
                " / ".join(shape["ours_order_mae"] for shape in shapes),
                " / ".join(shape["ours_order_rmse"] for shape in shapes),
                " / ".join(_peakedness(shape, "ours") for shape in shapes),
            )
        )
    printed = data["readings"][0]["best_shape"]
    about = (
        "Plants fitted to all sixteen numbers of Tables 2 and 3, so that nothing here is evidence. Misfit is the root mean "
        "square of log(ours/printed) after "
        f"{data['evaluations']:,} plants; seeds agree where their best misfits differ by at most 5 % or all are below 0.02. Orders and RMSE/MAE of "
        "Controllers 1, 2, 3 are those of the best plant, joint 2 / joint 3; printed are "
        f"{' / '.join(shape['printed_order_mae'] for shape in printed)} and "
        f"{' / '.join(_peakedness(shape, 'printed') for shape in printed)}."
    )
    return f"{_table('reading|misfit|seeds agree|order in MAE|in RMSE|RMSE/MAE', rows)}\n\n{about}"


def _peakedness(shape: dict[str, Any], whose: str) -> str:
    """RMSE over MAE of the three controllers."""
    return " ".join(f"{shape[f'{whose}_rmse_over_mae_controller_{k}']:.2f}" for k in (1, 2, 3))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports"))
