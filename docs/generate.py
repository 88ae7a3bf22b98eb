"""Copy what an ensemble and the ledger found beside this file, and write their parts of findings.md from it.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``. Every number between the
marks in findings.md comes from ``docs/results``; a test makes the text again and compares.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
RESULTS = DOCS / "results"
PAGE = DOCS / "findings.md"
PART = re.compile(r"(<!-- made by generate.py: (the answer|the ensemble) -->\n).*?(<!-- end -->)", re.S)
LEAST_PLANTS = 100
"""Fewer say nothing, by the rules in verdicts.md."""
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
    PAGE.write_text(fresh(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def fresh(text: str) -> str:
    """The page with its made parts made again."""
    makers = {"the answer": answer, "the ensemble": generated}
    return PART.sub(lambda part: f"{part[1]}\n{makers[part[2]]().strip()}\n\n{part[3]}", text)


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
        "in_reverse": share("share_c3_lt_c2_lt_c1", "all_ok"),
        "in_reverse_diverged_last": share("share_c3_lt_c2_lt_c1", "diverged_last"),
        "rmse_over_mae_rises": reading["share_rmse_over_mae_rises"]["both"],
        "distance": {key: _value(reading["distance"][key]) for key in ("median", "lowest")},
        "c1_c2": ratio("ratio_c1_c2"),
        "c2_c3": ratio("ratio_c2_c3"),
        "inside": len(reading["agreement"]["inside"]),
    }


def _value(number: Any) -> Any:
    return number["value"] if isinstance(number, dict) else number


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


def answer() -> str:
    """What a reader should take away, the strongest first."""
    summary, ledger = stored("ensemble.json"), stored("claims.json")
    box = summary["populations"]["box"]
    readings = {reading["name"]: reading for reading in box["readings"]}
    entries = {entry["id"]: entry for entry in ledger["claims"]}
    printed, motors = readings["printed"], readings["feedback=motor"]
    both = readings["phi_branch=power+weights=extrapolating"]
    both_motors = readings["phi_branch=power+weights=extrapolating+feedback=motor"]
    ratio, rises = printed["c1_c2"]["joint_2"], entries["F1"]["evidence"]
    ours = [entries[f"rmse_over_mae.controller_{k}.joint_2"]["ours"] for k in (1, 2, 3)]
    theirs = [
        float(entries[f"table2.controller_{k}.rmse.joint_2"]["printed"])
        / float(entries[f"table2.controller_{k}.mae.joint_2"]["printed"])
        for k in (1, 2, 3)
    ]
    sizes = [entry for name, entry in entries.items() if name.startswith(("table2", "table3.with"))]
    power = [entry["evidence"]["also_passing"] for entry in sizes]
    measured = {held["measure"]: held["share"] for held in entries["E1"]["evidence"]["by_measure"]}
    smoother = [
        held["share"]
        for held in entries["C6"]["evidence"]["statements"]
        if "torque step" in held["statement"]
    ]
    together = max(
        min(held["in_order"]["share"], held["rmse_over_mae_rises"]["share"])
        for held in readings.values()
        if held["in_order"]["plants"] >= LEAST_PLANTS
    )
    likeliest = max(held["share"] for held in entries["C2"]["evidence"]["statements"])
    contradicted = [entry for name, entry in entries.items() if name.startswith("share.")]
    with_drawn = sum("hardware=drawn" not in entry["readings_that_change_it"] for entry in contradicted)
    ok = [_percent(printed["ok"][f"controller_{k}"]) for k in (1, 2, 3)]
    lines = (
        "**As printed, the equations rank the laws the other way round.** On "
        f"{_share(printed['in_reverse'])} of the {printed['in_reverse']['plants']} plants on which all three laws track, out of "
        f"{box['plants']} drawn, the complete order is 3, 2, 1, in MAE and RMSE on both joints; the printed order 1, 2, 3 holds on "
        f"{_share(printed['in_order'])}. Laws that do not differ would show either on 2.8 %. "
        '"As printed" mends [two slips](slips.md), 9 and 14: φ is odd, and Controller 2\'s law has η. With either left as it stands the reverse order holds on '
        f"{_percent(readings['phi_negative=even']['in_reverse']['share'])} and "
        f"{_percent(readings['eta_in_controller_2=dropped']['in_reverse']['share'])}. "
        f"By the rules claim C2 is `{entries['C2']['verdict']}`, since the likeliest of its eight statements holds on "
        f"{_percent(likeliest)} and 5 % is the limit. "
        "[No plant is needed to see why](#why-no-plant-is-needed-for-the-order).",
        f"**So the printed ratios are contradicted.** Controller 1's MAE over Controller 2's on joint 2 is {ratio['median']:.2f}, "
        f"{ratio['q05']:.2f} to {ratio['q95']:.2f} on the central 90 % of the plants; the print has 0.90. "
        f"With encoder, output delay and filter as drawn instead of as printed the verdict stands for {with_drawn} of the "
        f"{len(contradicted)}, those of joint 3.",
        "**Two other readings together bring the order back**: weights (1 + α, −α) and the power branch of φ near zero. They give "
        f"the printed order on {_share(both['in_order'])} of {both['in_order']['plants']} plants, and with motor-side feedback on "
        f"{_share(both_motors['in_order'])} of {both_motors['in_order']['plants']}. Neither is what Eqs. (12) and (15) say, and they were found by trying "
        f"{len(readings)} readings. They do not bring all back: {both['inside']} of the 8 printed ratios lie in the central 90 %, and RMSE/MAE rises as "
        f"printed on {_percent(both['rmse_over_mae_rises']['share'])}. Under no reading that was run do "
        f"the printed order and that rise meet on more than {_percent(together)} of the plants. Whoever has the authors' code "
        "should look at those two lines first.",
        "**Of all readings, whose encoders the law looks at changes its stability most.** With those on the joints all three laws track on "
        f"{_percent(printed['in_reverse']['plants'] / box['plants'])} of the drawn plants, above all for want of tendon damping; with those "
        f"of the motors, whose count is fifty times finer, on {_percent(motors['in_reverse']['plants'] / box['plants'])}, where the errors are the motors' too. The paper's loops were stable; "
        "its section 5.2 speaks for encoders on the joints. The order does not depend "
        f"on it: with the motors' it is reversed on {_share(motors['in_reverse'])}.",
        "**The sizes of the errors say nothing.** All "
        f"{len(sizes)} numbers of Tables 2 and 3 lie inside the box, and so would {_percent(min(power))} to {_percent(max(power))} of a decade "
        "around each. Only orders and ratios can be tested without the plant.",
        "**One clue that needs no scale is not explained.** RMSE over MAE on joint 2 rises over Controllers 1 to 3 in the print, "
        f"{_listed(theirs)}; here the medians are {_listed(ours)}. "
        f"It rises on both joints on {_percent(rises['share'])} of the plants.",
        f"**What agrees with the print about α:** the torque is smoother on {'every plant judged' if min(smoother) == 1.0 else f'at least {_percent(min(smoother))}'}, and Controller 1 tracks on more "
        f"of the plants drawn, {ok[0]} against {ok[1]} and {ok[2]} of Controllers 2 and 3. "
        f"Whether the estimate is better hangs on the measure: by the RMS of its error, mostly the arm shaken by encoder counts, on {_percent(measured['RMS of epsilon'])}, "
        f"by what of it lies below 3 Hz on {_percent(measured['RMS of epsilon below 3 Hz'])}.",
        "**The kinematics are right** to the printed digits, but for the description of Fig. 6, which Eq. (1) with section 3.3's "
        "signs does not give.",
    )
    return "\n".join(f"- {line}" for line in lines)


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


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


def _distance(found: dict[str, Any]) -> str:
    if found["median"] is None:
        return "–"
    return f"{found['median']:.2f}, {found['lowest']:.2f}"


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
            _share(reading["in_reverse"]),
            _median(reading["c1_c2"]),
            _median(reading["c2_c3"]),
            f"{reading['inside']} of 8",
            _percent(reading["rmse_over_mae_rises"]["share"]),
            _distance(reading["distance"]),
        )
        for reading in summary["populations"]["box"]["readings"]
    )
    heads = (
        "reading|ok C1 / C2 / C3|all ok|1 < 2 < 3|3 < 2 < 1|C1/C2|C2/C3|ratios inside|RMSE/MAE rises|distance"
    )
    about = (
        "All ok: plants on which all three laws are; the rest is over those. Orders are in MAE and RMSE on both joints. "
        "Ratios are medians of the MAE, joint 2 / joint 3; inside are printed ratios within the central 90 %. RMSE/MAE "
        "rises from Controller 1 to 3 on both joints in the print. Distance: root mean square of log(ours/printed) over ratios of "
        "MAE and RMSE/MAE, which need no scale, of the median plant and of the closest."
    )
    return f"{_table(heads, rows)}\n\n{about}"


def _claims(ledger: dict[str, Any]) -> str:
    entries = {entry["id"]: entry for entry in ledger["claims"]}
    rows = []
    for name in [name for name in CLAIMS if name in entries]:
        entry = entries[name]
        share, others = entry["evidence"].get("share"), entry["readings_that_change_it"]
        held = _percent(share) if isinstance(share, float | int) else "–"
        held += _by_measure(entry["evidence"].get("by_measure", ()), entry["evidence"].get("measure"))
        more = f" and {len(others) - 4} more" if others[4:] else ""
        shown = ", ".join(f"`{other}`" for other in others[:4]) + more
        mark = " (borderline)" if entry["borderline"] else ""
        rows.append((name, entry["printed"], f"`{entry['verdict']}`{mark}", held, shown or "–"))
    remark = (
        "`contradicted` is about the equations and not about the measurement: the paper measured hardware."
    )
    return f"{_table('claim|printed|verdict|holds on|readings that change it', rows)}\n\n{remark}"


def _by_measure(rows: Sequence[dict[str, Any]], best: str | None) -> str:
    """By which measure a claim holds most often, and on how much by the others."""
    if not rows:
        return ""
    others = ", ".join(f"{row['measure']} {_percent(row['share'])}" for row in rows if row["measure"] != best)
    return f" by {best}; {others}"


def _numbers(ledger: dict[str, Any]) -> str:
    counts: dict[str, Counter[str]] = {}
    for entry in ledger["claims"]:
        if entry["id"] not in CLAIMS:
            mark = " (borderline)" if entry["borderline"] else ""
            counts.setdefault(entry["id"].partition(".")[0], Counter())[f"`{entry['verdict']}`{mark}"] += 1
    words = {
        table: ", ".join(f"{count} {name}" for name, count in row.items()) for table, row in counts.items()
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
