"""What `identify` found as tables, and the best plant as a configuration of `compare`."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS
from tendonrepro.configuration.rows import idle_rows
from tendonrepro.configuration.strict_yaml import Tree, dump, entry
from tendonrepro.console import count_of
from tendonrepro.files import Json, write_atomically
from tendonrepro.identification.bench import Goal, Simulated
from tendonrepro.monte_carlo.population import Population
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result

CONFIG = "identified.yaml"
"""The best plant of all."""

PLANTS = "plants"
"""Folder with the best plant under each reading."""

AT_BOUND = 0.01
"""Share of a row's range within which the best plant counts as at its bound."""

WIDE = 0.25
"""Share of a row's range beyond which plants that fit alike do not determine it."""

_FOLLOWS = {"links.com": ("links.length",), "links.inertia": ("links.mass", "links.length")}
"""Values of an arm that move with others, too."""
_DRAWN = "assumed: draw from the box, "
_HELD = "not searched but of the arm at the start, "
_OF_JOINT = re.compile("(_joint)?_[23]$")
"""End of a row's name that a source leaves out."""

_OF_READINGS = ("name", "misfit_log", "low", "high", "in_order", "found_by")
_OF_KNOWN = ("name", "best", "lowest", "highest", "value", "value_unit", "known")
"""Columns for a terminal."""


def nearest_search(searches: Sequence[Json]) -> Json:
    """The reading that fits best."""
    return min(searches, key=lambda search: search["misfit_log"])


def identification_result(
    head: Json, searches: Sequence[Json], goal: Goal, box: Population, remarks: Sequence[str]
) -> Result:
    """Everything that is written and shown; some remarks come first.

    A search is what was found for one reading. A row of its `searches`, the nearer first, has the median
    misfit of the repeats, its quartiles, the share of them with the order of the goal, and the lowest misfit
    that was seen. Rows of `numbers` and `best_shape` have keys that name whose they are, those of
    `parameters` and `known` a row of the ranges each.
    """
    from tendonrepro.identification.figures import draw_numbers

    best = nearest_search(searches)
    answers, open_ends = [*remarks, conclusion(searches[0], goal, _within(box))], unknown(best, goal)
    data = {**head, "readings": searches, "conclusions": answers, "unknown": open_ends}
    numbers: list[Json] = []
    parameters: list[Json] = []
    for answer in searches:
        known = {row["name"]: row for row in answer["known"]}
        numbers += [{"reading": answer["name"], **row} for row in answer["numbers"]]
        parameters += [
            {"reading": answer["name"], **row, **known.get(row["name"], {})} for row in answer["parameters"]
        ]
    captions = (
        f"Best plant under each reading; misfit as root mean square of log(ours/{goal.word}), the median and "
        "quartiles of repeats with masses moved by a millionth, and the share of these in order.",
        f"{goal.word.capitalize()} numbers, the best plant's, and those of plants that come near.",
        "Every row of the box on the best plant and on those that come near; of each row that was searched "
        "what the numbers tell, by all plants that come near.",
    )
    shown = ("run", "metric", "joint", "ours_deg", f"{goal.word}_deg", "ratio", "lowest_deg", "highest_deg")
    of_best = Table("best", f"Best plant{_under(best, goal)}.", best["numbers"], terminal=shown)
    parts: list[Table | str] = [
        "\n".join(answers),
        Table("identify_readings", captions[0], [*map(_scalars, searches)], terminal=_OF_READINGS),
        of_best.text(),
        Table("identify_numbers", captions[1], numbers, terminal=()),
        Table("identify_parameters", captions[2], parameters, terminal=()),
    ]
    if len(searches) == 1 and len(best["known"]) <= goal.numbers:
        caption = "What the numbers tell of each row that was searched, by all plants that come near."
        columns = [name for name in _OF_KNOWN if name in best["known"][0]]
        parts.append(Table("known", caption, best["known"], terminal=columns).text())
    parts += [
        "\n".join(open_ends),
        f"tendonrepro compare --config {head['config']} shows the best plant's traces.",
    ]
    below = (
        f"Errors over the {goal.word} ones under the reading {best['name']}: best plant (circle) and the "
        f"range of {best['near_count']} plants that miss what was fitted by at most {best['near_limit']:.3g}."
    )
    drawing = partial(draw_numbers, best["numbers"], goal.word, below, goal.origin)
    return Result(data, parts, {"identify_numbers": drawing})


def _scalars(answer: Json) -> Json:
    """Row of the table of readings: the nearer search, and the misfit of each."""
    plain = {key: value for key, value in answer.items() if not isinstance(value, list)}
    nearer = {key: value for key, value in answer["searches"][0].items() if key != "search"}
    each = {f"misfit_log_{one['search']}": one["misfit_log"] for one in answer["searches"]}
    return plain | nearer | {"found_by": answer["searches"][0]["search"]} | dict(sorted(each.items()))


def conclusion(first: Json, goal: Goal, within: str) -> str:
    """Whether a plant fits under the first reading."""
    answer = f"A plant within {within} gives" if first["fits"] else "No plausible plant found for"
    numbers = f"the {count_of(goal.numbers, 'number')} of {goal.name}"
    return f"{answer} {numbers}{_under(first, goal)}: best misfit {first['misfit_log']:.3g} in log ratio."


def _under(search: Json, goal: Goal) -> str:
    """Which interpretation of the paper, in words; none of a comparison as it is."""
    named = f" under {search['name']}" if goal.of_paper or search["name"] != PRINTED else ""
    return named + ", whose errors are of motors" * ("feedback=motor" in search["name"])


def unknown(best: Json, goal: Goal) -> list[str]:
    """What the best reading's search leaves open."""
    rows, open_rows = best["known"], [row["name"] for row in best["known"] if not row["determined"]]
    counted = f"{count_of(len(rows), 'parameter')} fitted to {count_of(goal.numbers, 'number')}"
    if len(rows) > goal.numbers:
        return [f"{counted}: more parameters than numbers, so no parameter is determined."]
    if not best["fits"]:
        return [f"{counted}, and no plant fits, so no parameter is determined."]
    alike = f"plants that miss them by at most {best['near_limit']:.2g} in log ratio"
    if open_rows:
        return [f"{counted}: {alike} do not determine {', '.join(open_rows)}."]
    return [f"{counted}: {alike} determine each, as far as the model is right."]


def write_config(path: Path, config: CompareConfig, box: Population, goal: Goal, search: Json) -> None:
    """Write the best plant under a reading as a configuration, and read it back as a check."""
    sourced = _sourced_arm if box.around else _sourced_draw
    source = f"identified: {goal.name}, misfit {search['misfit_log']:.2g}"
    tree = sourced(config, box, source, search["rows_searched"])
    tree["title"] = f"{config.title}, plant fitted to {goal.name}"
    rows = search["parameters"]
    bounds = [f"{row['name']} ({row['at_bound']})" for row in rows if row["at_bound"]]
    is_all = all(row["searched"] for row in rows)
    searched = "all rows" if is_all else f"{', '.join(search['rows_searched'])}; the others are the arm's"
    heading = f"""\
# Fitted to {goal.name}{" of the paper" * goal.of_paper}{_under(search, goal)},
# by tendonrepro identify; identify.json says how.
# Misfit {search["misfit_log"]:.3g}, root mean square of log(ours/{goal.word}), by the compiled stepper,
# the median of repeats with masses moved by a millionth.
# It proves nothing: what was fitted to {goal.origin} cannot be evidence for it.
# Searched: {searched}.
# At a bound of {_within(box)}: {", ".join(bounds) or "none of them"}.

"""
    path.parent.mkdir(exist_ok=True)
    write_atomically(path, heading + dump(tree))
    load_config(path, "compare")


def _within(box: Population) -> str:
    return "these ranges" if box.around else "the box"


def _sourced_draw(config: CompareConfig, box: Population, source: str, rows: Sequence[str]) -> Tree:
    """A draw of the paper's ranges; each number says whether its row was searched, or is the base's."""
    del box
    searched = "|".join(f"{row}|{_OF_JOINT.sub('', row)}" for row in rows)

    def told(drawn: re.Match[str]) -> str:
        is_searched = re.search(rf"\b({searched})\b", drawn[1])
        return f"{source}, " + ("" if is_searched else _HELD) + drawn[1]

    return _plain(re.sub(f'{_DRAWN}([^"]*)', told, config.model_dump_json(exclude_none=True)))


def _sourced_arm(config: CompareConfig, box: Population, source: str, rows: Sequence[str]) -> Tree:
    """An arm of one's own; what was not searched keeps the source that it has."""
    tree, base = _plain(config.model_dump_json(exclude_none=True)), box.loaded.base
    for key in dict.fromkeys(row.key for row in box.rows):
        moving = (key, *_FOLLOWS.get(key, ()))
        searched = [row for row in box.rows if row.key in moving and row.name in rows]
        path = ("manipulator", *key.split("."))
        value = entry(tree, path)
        value["source"] = own = entry(base.tree, path)["source"]
        if searched:
            moved = {row.joint for row in searched}
            all_joints = None in moved or len(moved) == config.manipulator.joints
            others = "" if all_joints else f"; the others {own}"
            value["source"] = f"{source}, {', '.join(row.name for row in searched)}{others}"
    if tree["reference"]["kind"] == "sampled":
        # The file that names it now lies elsewhere.
        tree["reference"]["file"] = str((base.folder / tree["reference"]["file"]).resolve())
    return tree


def _plain(text: str) -> Tree:
    """JSON as plain values, an integer where a number is whole: the schema wants counts to be."""

    def plain(number: str) -> float:
        value = float(number)
        return int(value) if value.is_integer() else value

    found: Tree = json.loads(text, parse_float=plain)
    return found


def arm_values(config: CompareConfig, box: Population) -> dict[str, tuple[float, str]]:
    """The value that each factor gives an arm of one's own, with its unit, by the row's name."""
    found, arm = {}, _plain(config.manipulator.model_dump_json())
    for row in box.rows if box.around else ():
        quantity = entry(arm, row.key.split("."))
        held = np.atleast_1d(quantity["value"])[row.joint - 1 if row.joint else -1]
        found[row.name] = float(held), quantity["unit"]
    return found


def number_rows(plants: Simulated, goal: Goal) -> list[Json]:
    """Every number of a goal, the first plant's, and the range of those whose run is ok."""
    rows = []
    for (r, m, i), theirs in np.ndenumerate(goal.values):
        if np.isnan(theirs):
            continue
        ours, sizes = float(plants.sizes[0, r, m, i]), plants.sizes[plants.ok[:, r], r, m, i]
        rows.append(
            {
                "run": goal.runs[r],
                "metric": METRICS[m],
                "joint": goal.joints[i],
                "fitted": bool(goal.fitted[r, m, i]),
                f"{goal.word}_deg": float(theirs),
                "ours_deg": ours,
                "ratio": ours / float(theirs),
                "lowest_deg": float(sizes.min()) if sizes.size else np.nan,
                "highest_deg": float(sizes.max()) if sizes.size else np.nan,
            }
        )
    return rows


def shape_rows(best: Simulated, goal: Goal) -> list[Json]:
    """Order of the runs without payload and RMSE over MAE, ours and those of a goal."""
    rows = []
    names = [goal.runs[r].removeprefix("controller_") for r in goal.compared]
    for i, joint in enumerate(goal.joints):
        row: Json = {"joint": joint}
        for name, sizes in {"ours": best.sizes[0, ..., i], goal.word: goal.values[..., i]}.items():
            for m, metric in enumerate(METRICS):
                order = np.argsort(sizes[goal.compared, m], kind="stable")
                row[f"{name}_order_{metric}"] = " < ".join(names[k] for k in order)
            for r, run in enumerate(goal.runs):
                row[f"{name}_rmse_over_mae_{run}"] = float(sizes[r, 1] / sizes[r, 0])
        rows.append(row)
    return rows


def known_rows(box: Population, units: Array, numbers: int, *, fits: bool) -> list[Json]:
    """What is known of every row that was searched, by points (N, P) that come near, the best first.

    ``of_range`` is how much of its range they take up. More rows than numbers determine none of them, and
    where the best does not fit there is nothing to be known.
    """
    values, searched = box.values(units), np.flatnonzero(box.free).tolist()
    alone = bool((units == units[0]).all())
    rows: list[Json] = []
    for p in searched:
        words, ends = box.rows[p].words, (float(values[:, p].min()), float(values[:, p].max()))
        # Of a choice two words are all there is to say.
        share = float(ends[0] < ends[1] if box.rows[p].choices else np.ptp(units[:, p]))
        if len(searched) > numbers:
            why = "more parameters than numbers"
        elif not fits:
            why = "no plant fits"
        elif alone:
            why = "no other plant comes near, search longer"
        else:
            why = f"spread over {share:.0%} of its range" if share > WIDE else ""
        best, low, high = (words[int(x)] if words else float(x) for x in (values[0, p], *ends))
        rows.append(
            {
                "name": box.rows[p].name,
                "unit": box.rows[p].unit,
                "best": best,
                "lowest": low,
                "highest": high,
                "of_range": share,
                "determined": not why,
                "known": f"not determined: {why}" if why else "yes",
            }
        )
    return rows


def parameter_rows(box: Population, best: Array) -> list[Json]:
    """Every row of the box at a point (P,); what is off there is at no bound."""
    values = box.values(best[np.newaxis])[0]
    idle = set() if box.around else idle_rows(box.named(values))
    rows: list[Json] = []
    for row, value, unit in zip(box.rows, values.tolist(), best.tolist(), strict=True):
        can_lean = row.free and not row.choices and row.name not in idle
        rows.append(
            {
                "name": row.name,
                "unit": row.unit,
                "low": row.low,
                "high": row.high,
                "searched": row.free,
                "best": row.words[int(value)] if row.words else value,
                "at_bound": _bound(unit) if can_lean else None,
            }
        )
    return rows


def _bound(unit: float) -> str | None:
    return "low" if unit < AT_BOUND else "high" if unit > 1.0 - AT_BOUND else None
