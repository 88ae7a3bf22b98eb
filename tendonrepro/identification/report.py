"""What `identify` found as words, tables and a configuration that `compare` runs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tendonrepro.configuration.fields.strict_yaml import Node, dump
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.console import columns
from tendonrepro.files import write_atomically
from tendonrepro.results.tables import rounded, write_table

CONFIG = "identified.yaml"

_DRAWN = "assumed: draw from the box, "
_ROW = re.compile(
    r"[a-z]+_[a-z0-9_]+|\b(?:posture|motion|disturbance|amplitude|period|rise|hold|velocity|acceleration)\b"
)
_HELD = "held at its nominal value: "
_FAR_BETTER = 0.5
_CAPTIONS = {
    "identify_readings": "Best plant under each reading; misfit as root mean square of log(ours/printed).",
    "identify_numbers": "Printed numbers, the best plant's, and the central 90 % of near-optimal plants.",
    "identify_shape": "What of the best plant needs no scale: order of the controllers and RMSE over MAE.",
    "identify_order": "Share of the near-optimal plants on which the printed order holds.",
    "identify_parameters": "What the fit says about each row of the box; width 1: nothing, 0: everything.",
    "identify_pareto": "Plants that no other beats in both misfits.",
}


def write_config(path: Path, config: CompareConfig, data: Mapping[str, Any], held: Mapping[str, Any]) -> None:
    """Write the best plant of a reading as a configuration of `compare`, and read it back as a check."""
    searched = held["rows_searched"]
    source = f"identified: {_numbers(data)}, misfit {held['misfit_log']:.2g}, "

    def sourced(node: Any) -> Node:
        if isinstance(node, dict):
            return {key: sourced(value) for key, value in node.items()}
        if isinstance(node, list):
            return [sourced(value) for value in node]
        if isinstance(node, float) and node.is_integer():
            return int(node)  # the schema wants counts to be whole
        if isinstance(node, str) and node.startswith(_DRAWN):
            what = node.removeprefix(_DRAWN)
            # A vector is of rows that are numbered by joint.
            rows = tuple(_ROW.findall(what))
            is_held = bool(rows) and not any(row.startswith(rows) for row in searched)
            return f"{source}{_HELD if is_held else ''}{what}"
        return node  # type: ignore[no-any-return]

    tree = sourced(config.model_dump(mode="json", exclude_none=True))
    assert isinstance(tree, dict)
    tree["title"] = f"{config.title}, plant fitted to {_numbers(data)}"
    write_atomically(path, _head(data, held) + dump(tree))
    load_config(path, "compare")


def _numbers(data: Mapping[str, Any]) -> str:
    return "Tables 2 and 3" if data["fit"] == "all" else "Controller 2 of Table 2"


def _head(data: Mapping[str, Any], held: Mapping[str, Any]) -> str:
    searched = f"{len(held['rows_searched'])} unknowns"
    if data["fit"] == "all":
        searched += " for 16 numbers"
    lines = (
        f"Fitted to {_numbers(data)} of the paper under the reading {held['name']},",
        f"by tendonrepro identify --fit {data['fit']} --window {data['window']} --readings {held['name']}",
        f"--generations {data['generations']} --population {data['population']} --seeds {data['seeds']}.",
        f"Misfit {held['misfit_log']:.3g}, root mean square of log(ours/printed), by the compiled stepper. "
        f"{searched}",
        "were searched, the other rows of the box kept their nominal value. It proves nothing: what was",
        "fitted to the print cannot be evidence for it, and other plants may fit as well or better.",
        f"At a bound of the box: {_at_bounds(held) or 'none of them'}.",
        f"Chosen: {_chosen(held)}.",
    )
    return "".join(f"# {line}\n" for line in lines) + "\n"


def _chosen(held: Mapping[str, Any]) -> str:
    """Choices that were searched: what the plant owes to effects that are in no equation."""
    rows = (row for row in held["parameters"] if row["choice"] and row["searched"])
    return ", ".join(f"{row['name']} {row['best']}" for row in rows) or "nothing"


def _at_bounds(held: Mapping[str, Any]) -> str:
    """Rows that the best plant leans on, and on which end."""
    return ", ".join(f"{row['name']} ({row['at_bound']})" for row in held["parameters"] if row["at_bound"])


def conclusions(data: Mapping[str, Any]) -> list[str]:
    """Sentences that follow from the numbers."""
    first, best = data["readings"][0], min(data["readings"], key=lambda held: held["misfit_log"])
    target = "Controller 2's four numbers" if data["fit"] == "controller_2" else "all sixteen numbers"
    found = [_fit_sentence(first, target, data["near_tolerance"])]
    if not first["fits"] and best["misfit_log"] <= _FAR_BETTER * first["misfit_log"]:
        found.append(
            f"The tables fit the reading {best['name']} far better than {first['name']}: "
            f"misfit {best['misfit_log']:.3g} against {first['misfit_log']:.3g}."
        )
    apart = [held["name"] for held in data["readings"] if not held["seeds_agree"]]
    if apart:
        found.append(
            f"Seeds do not agree, so that more generations may come closer, under {', '.join(apart)}."
        )
    for held in data["readings"] if data["judged"] else []:
        found += _judged_sentences(held)
    if bounds := _at_bounds(first):
        found.append(f"The best plant under {first['name']} lies at a bound in {bounds}.")
    return found


def _fit_sentence(held: Mapping[str, Any], target: str, tolerance: float) -> str:
    misfit = held["misfit_log"]
    if misfit >= 1.0:
        return f"No plausible plant found under {held['name']} whose runs end well, best misfit {misfit:.3g}."
    size = f"{misfit:.3g} in log ratio, {held['misfit_rounding']:.3g} half units of the last digit"
    if misfit > tolerance:
        return f"No plausible plant found under {held['name']} for {target}, best misfit {size}."
    return f"A plant within the box gives {target} under {held['name']}: misfit {size}."


def _judged_sentences(held: Mapping[str, Any]) -> Iterator[str]:
    numbers = [row for row in held["numbers"] if row["verdict"] != "fitted"]
    reached = sum(row["verdict"] == "reached" for row in numbers)
    never = [_name(row) for row in numbers if row["verdict"] == "not_reached"]
    if held["near_count"] == 0 or any(row["verdict"] == "too_few_plants" for row in numbers):
        yield f"{held['name']}: too few near-optimal plants ({held['near_count']}) to judge the others by."
        return
    text = f"{held['name']}: of {len(numbers)} numbers that were not fitted {reached} lie in the range of "
    text += f"{held['near_count']} plants that fit"
    yield text + (f"; none of these plants reaches {', '.join(never)}." if never else ".")
    row = next(row for row in held["order"] if len(row["runs"]) == 3 and row["joint"] == "both")
    word = row["verdict"].replace("_", " ")
    share = f"{100.0 * row['share']:.0f} %"
    yield f"{held['name']}: the printed order of the controllers holds on {share} of them: {word}."


def _name(row: Mapping[str, Any]) -> str:
    return f"{row['run']} {row['metric'].upper()} joint {row['joint']}"


def identify_text(data: Mapping[str, Any]) -> str:
    """Text for a terminal."""
    if data.get("dry_run"):
        names = ", ".join(data["searches"])
        return (
            f"identify: fits {data['fit']} under {len(data['readings'])} readings by {len(data['searches'])} "
            f"searches ({names}) of {data['evaluations']} plants\nwould write to {data['out']}"
        )
    parts = ["\n".join(data["conclusions"])]
    rows = [("reading", "misfit", "half units", "seeds agree", "near plants")]
    for held in data["readings"]:
        agree = "yes" if held["seeds_agree"] else "no"
        units, near = rounded(held["misfit_rounding"]), str(held["near_count"])
        rows.append((held["name"], f"{held['misfit_log']:.4f}", units, agree, near))
    parts.append(columns(rows))
    shown = min(data["readings"], key=lambda held: held["misfit_log"])
    parts.append(f"Best plant, reading {shown['name']}, deg\n{_numbers_text(shown)}")
    parts.append(_shape_text(shown))
    parts.append(
        f"Tables and figures are in {data['out']}; run "
        f"tendonrepro compare --config {data['config']} --out {data['out']}_compare"
    )
    return "\n\n".join(parts)


def _numbers_text(held: Mapping[str, Any]) -> str:
    rows: list[Sequence[str]] = [("", "ours", "printed", "ratio", "near-optimal plants", "")]
    for row in held["numbers"]:
        ends = f"{rounded(row['near_low_deg'])} to {rounded(row['near_high_deg'])}"
        word = row["verdict"].replace("_", " ")
        values = (f"{row['ours_deg']:.3f}", f"{row['printed_deg']:.3f}", f"{row['ratio']:.3f}")
        rows.append((_name(row), *values, ends, word))
    return columns(rows)


def _shape_text(held: Mapping[str, Any]) -> str:
    """Order and RMSE over MAE of the best plant."""
    lines = []
    for row in held["best_shape"]:
        for name in ("ours", "printed"):
            ratios = " ".join(f"{row[f'{name}_rmse_over_mae_controller_{k}']:.2f}" for k in (1, 2, 3))
            order = f"{row[f'{name}_order_mae']} in MAE, {row[f'{name}_order_rmse']} in RMSE"
            lines.append(f"joint {row['joint']}, {name}: {order}; RMSE/MAE of Controllers 1 to 3 {ratios}")
    return "\n".join(lines)


def write_identify_tables(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write all tables as csv (full digits) and Markdown (rounded)."""
    readings = data["readings"]
    held = [key for key, value in readings[0].items() if not isinstance(value, dict | list)]
    tables = {
        "identify_readings": [{key: reading[key] for key in held} for reading in readings],
        "identify_numbers": _gathered(readings, "numbers"),
        "identify_shape": _gathered(readings, "best_shape"),
        "identify_order": _gathered(readings, "order"),
        "identify_parameters": _gathered(readings, "parameters"),
        "identify_pareto": [
            {"reading": reading["name"], "pair": pair, "plant": point["plant"], "first": x, "second": y}
            for reading in readings
            for pair, points in reading["pareto"].items()
            for point in points
            for x, y in [[value for key, value in point.items() if key != "plant"]]
        ],
    }
    written = (write_table(rows, folder, stem, _CAPTIONS[stem]) for stem, rows in tables.items() if rows)
    return [path for paths in written for path in paths]


def _gathered(readings: Sequence[Mapping[str, Any]], key: str) -> list[dict[str, Any]]:
    return [{"reading": reading["name"], **row} for reading in readings for row in reading[key]]
