"""Tables made of stored results, for the page and for docs/tables.md; a cell is Markdown of one line."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tendonrepro.report.answer import percent
from tendonrepro.report.findings import interval


@dataclass(frozen=True)
class Table:
    """Headings, rows of cells, and what has to be known to read them."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    about: str = ""


def thinned(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of an ensemble's ``summary.json``: what is shown, and what it is of."""
    kept = [
        "tendonrepro_version",
        "config_sha256",
        "draws",
        "scramblings",
        "conclusions",
        "spot_check",
        "cost",
    ]
    populations = {
        name: {"plants": held["plants"], "readings": [_thin_reading(reading) for reading in held["readings"]]}
        for name, held in summary["populations"].items()
    }
    return {key: summary[key] for key in kept} | {"populations": populations}


def _thin_reading(reading: Mapping[str, Any]) -> dict[str, Any]:
    def ratio(key: str) -> dict[str, Any]:
        numbers = reading[key]["all_ok"]["mae"]
        return {
            joint: {name: numbers[joint][name]["value"] for name in ("q05", "median", "q95")}
            for joint in numbers
        }

    def share(key: str, plants: str) -> Any:
        return reading[key][plants]["mae_and_rmse"]["both"]

    last = {
        name: share(key, "diverged_last")
        for name, key in (
            ("in_order", "share_c1_lt_c2_lt_c3"),
            ("in_reverse", "share_c3_lt_c2_lt_c1"),
            ("first_best", "share_c1_best"),
        )
    }
    return {
        "name": reading["name"],
        "ok": {run: shares["ok"]["share"] for run, shares in reading["status"].items()},
        "in_order": share("share_c1_lt_c2_lt_c3", "all_ok"),
        "in_reverse": share("share_c3_lt_c2_lt_c1", "all_ok"),
        "first_best": share("share_c1_best", "all_ok"),
        "rmse_over_mae_rises": reading["share_rmse_over_mae_rises"]["both"],
        "smoother": reading["share_c1_smoother"],
        "order_and_smoother": reading["share_order_and_smoother"],
        "order_and_rise": reading["share_order_and_rise"],
        "order_rise_and_smoother": reading["share_order_rise_and_smoother"],
        "diverged_last": last,
        "reverse_near_print": reading["share_reverse_near_print"],
        "growth": {
            joint: {name: _value(found[name]) for name in ("median", "highest")}
            for joint, found in reading["rmse_over_mae_growth"].items()
        },
        "distance": {key: _value(reading["distance"][key]) for key in ("median", "lowest")},
        "c1_c2": ratio("ratio_c1_c2"),
        "c2_c3": ratio("ratio_c2_c3"),
        "inside": len(reading["agreement"]["inside"]),
    }


def _value(number: Any) -> Any:
    return number["value"] if isinstance(number, dict) else number


def thinned_closest(data: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of ``tendonrepro identify --fit all``."""
    kept = ["name", "misfit_log", "misfit_by_seed", "seeds_agree", "rows_searched", "best_shape"]
    readings = [
        {key: reading[key] for key in kept}
        | {
            "evaluations": data["evaluations"],
            "largest": max(reading["numbers"], key=lambda row: abs(math.log(row["ratio"]))),
            "at_bound": {row["name"]: row["at_bound"] for row in reading["parameters"] if row["at_bound"]},
        }
        for reading in data["readings"]
    ]
    return {key: data[key] for key in ("fit", "window")} | {"readings": readings}


def thinned_decides(rankings: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of ``decides.json``: the five unknowns that explain most."""
    return {name: held | {"rows": held["rows"][:5]} for name, held in rankings.items()}


def head(summary: Mapping[str, Any]) -> str:
    """How large an ensemble is, and how its runs were checked."""
    populations, check = summary["populations"], summary["spot_check"]
    firm = f" and {populations['firm']['plants']} of its firm rows" if "firm" in populations else ""
    text = (
        f"{populations['box']['plants']} plants of the box{firm}, {len(populations['box']['readings'])} "
        f"readings, {summary['scramblings']} scramblings, {summary['cost']['experiments']:,} runs. "
    )
    if check["compared"]:
        text += (
            f"{check['experiments']} runs were repeated with the SciPy stepper; on the {check['compared']} that "
            f"ran to their end MAE and RMSE differ by at most "
            f"{percent(check['ideal']['largest'])} with ideal encoders (in `{check['ideal']['where'].split(', ')[1]}`) and "
            f"{percent(check['quantised']['largest'])} with counts; {check['disagreements']} of the {check['experiments']} ended with another status. "
        )
    return text + "Brackets are 95 % intervals from the scramblings."


def readings(summary: Mapping[str, Any]) -> Table:
    """What each reading makes of the printed ranking."""
    heads = "reading|ok C1 / C2 / C3|all ok|1 < 2 < 3|3 < 2 < 1|1 best|C1/C2|C2/C3|ratios inside|RMSE/MAE rises|distance"
    rows = [
        (
            f"`{reading['name']}`",
            " / ".join(percent(reading["ok"][f"controller_{k}"]) for k in (1, 2, 3)),
            str(reading["in_order"]["plants"]),
            interval(reading["in_order"]),
            interval(reading["in_reverse"]),
            percent(reading["first_best"]["share"]),
            _median(reading["c1_c2"]),
            _median(reading["c2_c3"]),
            f"{reading['inside']} of 8",
            percent(reading["rmse_over_mae_rises"]["share"]),
            _distance(reading["distance"]),
        )
        for reading in summary["populations"]["box"]["readings"]
    ]
    about = (
        "All ok: plants on which all three laws are; the rest is over those. Orders are in MAE and RMSE on both joints, the "
        "best law first; 1 best: Controller 1 has the smallest errors, whatever the others. Ratios are medians of the MAE, joint 2 / joint 3; inside are printed ratios within the central 90 %. RMSE/MAE "
        "rises from Controller 1 to 3 on both joints in the print. Distance: root mean square of log(ours/printed) over ratios of "
        "MAE and RMSE/MAE, which need no scale, of the median plant and of the closest."
    )
    return Table(heads.split("|"), rows, about)


def _median(ratio: Mapping[str, Any]) -> str:
    values = (ratio[f"joint_{joint}"]["median"] for joint in (2, 3))
    return " / ".join("–" if value is None else f"{value:.2f}" for value in values)


def _distance(found: Mapping[str, Any]) -> str:
    return "–" if found["median"] is None else f"{found['median']:.2f}, {found['lowest']:.2f}"


def decides(rankings: Mapping[str, Any]) -> Table:
    """Which unknowns decide claims and ratios."""
    rows = []
    for name, held in rankings.items():
        shares = list(above_chance(held).items())[:3]
        shown = ", ".join(f"`{row}` {percent(share)}" for row, share in shares)
        rows.append((decided(name), shown or "none above chance", percent(held["unexplained"])))
    heads = ["of", "share of the variance that an unknown explains alone", "no single one explains"]
    return Table(heads, rows)


def above_chance(ranking: Mapping[str, Any]) -> dict[str, float]:
    """Shares of the variance that single unknowns explain, where chance does not, the largest first."""
    floor = ranking["noise_floor"]
    return {
        row["name"]: row["index"] for row in ranking["rows"] if row["index"] > max(row["half_width"], floor)
    }


def decided(name: str) -> str:
    """A claim, or the ratio of Controllers 1 and 2 on a joint, for a reader."""
    return f"C1/C2, {name.removeprefix('ratio_').replace('_', ' ')}" if name.startswith("ratio") else name


def closest(data: Mapping[str, Any]) -> Table:
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
    (plants, _), *others = Counter(reading["evaluations"] for reading in data["readings"]).most_common()
    longer = [held for held in data["readings"] if held["evaluations"] in dict(others)]
    told = "".join(f", {held['evaluations']:,} under `{held['name']}`" for held in longer)
    about = (
        "Plants fitted to all sixteen numbers of Tables 2 and 3, so that nothing here is evidence. Misfit is the root mean "
        "square of log(ours/printed) after "
        f"{plants:,} plants{told}; seeds agree where their best misfits differ by at most 5 % or all are below 0.02; a misfit above 1 is a penalty: no plant was found on which all runs track, and the rest of its row means nothing. Orders and RMSE/MAE of "
        "Controllers 1, 2, 3 are those of the best plant, joint 2 / joint 3; printed are "
        f"{' / '.join(shape['printed_order_mae'] for shape in printed)} and "
        f"{' / '.join(_peakedness(shape, 'printed') for shape in printed)}."
    )
    return Table(["reading", "misfit", "seeds agree", "order in MAE", "in RMSE", "RMSE/MAE"], rows, about)


def _peakedness(shape: Mapping[str, Any], whose: str) -> str:
    """RMSE over MAE of the three controllers."""
    return " ".join(f"{shape[f'{whose}_rmse_over_mae_controller_{k}']:.2f}" for k in (1, 2, 3))


def statics(data: Mapping[str, Any]) -> Table:
    """Tensions over the working half-plane, by course of tendon 4 and by case."""
    rows = [
        (
            f"`{course}`",
            case.replace("_", " "),
            percent(over["share_tense"]),
            f"{over['least_tension_N']:.1f}",
            str(over["tendon"]),
            f"{float(held['change_of_length_mm']):.0f}",
        )
        for course, held in data["courses"].items()
        for case, over in held["half_plane"].items()
    ]
    heads = [
        "course of tendon 4",
        "case",
        "all tense on",
        "least tension (N)",
        "of tendon",
        "its length varies by (mm)",
    ]
    payload = f"{data['payload_kg']:g} kg payload where a case has one"
    about = f"At rest, over {data['postures']} postures with all links in the working half-plane; tendon 4 pulls with "
    return Table(heads, rows, f"{about}{data['tensioner_force_N']:g} N; {payload}.")
