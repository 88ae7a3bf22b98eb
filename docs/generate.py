"""Write from the stored results what docs are made of: ``python docs/generate.py [REPORTS]``.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``. With a folder of reports it takes over
their results first. It writes the made parts of README, findings.md and others, and the pictures of findings.md.
"""

from __future__ import annotations

import math
import re
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from harvest import take
from pages import fresh, table
from stored_results import DOCS, nearest, stored

from tendonrepro.configuration.shown import BOTH, CHANGED, GROUPS, KEPT, SHOWN, STEPS
from tendonrepro.evidence.figure_predictions import draw_predictions
from tendonrepro.monte_carlo.summary import RankingShares, ErrorRatio, in_all_errors, median
from tendonrepro.reporting import contents
from tendonrepro.reporting.contents import percent
from tendonrepro.reporting.figures import draw_map, draw_orders, draw_ranges
from tendonrepro.results.figures.style import Drawing, save_drawing
from tendonrepro.tuning.figure import draw_tuning
from tendonrepro.tuning.laws import LAWS
from tendonrepro.verdicts.ledger import read_ledger
from tendonrepro.verdicts.verdict import Verdict

README = DOCS.parent / "README.md"
PAGES = (README, DOCS / "findings.md", DOCS / "predictions.md", DOCS / "tables.md", DOCS / "tune.md")

Column = Callable[[Any], str]


def write_pages() -> None:
    """Fill the made parts of the pages, draw the pictures, and describe them where they stand."""
    drawn = pictures()
    for page in (*DOCS.glob("*.md"), README):
        text = page.read_text(encoding="utf-8")
        page.write_text(described(fresh(text, MAKERS) if page in PAGES else text, drawn), encoding="utf-8")
    with TemporaryDirectory() as folder:
        for drawing in drawn.values():
            save_drawing(drawing, Path(folder))
            shutil.copy(Path(folder) / f"{drawing.stem}.png", DOCS)


def pictures() -> dict[str, Drawing]:
    """The pictures of stored results, by name."""
    summary, found, tuned = stored("ensemble"), stored("predict"), stored("tune")
    drawn = (
        draw_orders(summary),
        draw_map(summary, stored("closest")),
        draw_ranges(summary),
        draw_tuning(
            tuned["laws"], {name: law.title for name, law in LAWS.items()}, on=f"{tuned['plants']} plants"
        ),
        draw_predictions(found["experiments"], found["readings"], found["joints"]),
    )
    return {drawing.stem: drawing for drawing in drawn}


def described(text: str, drawn: Mapping[str, Drawing]) -> str:
    """A page whose pictures have the first sentence of their captions as the text instead of them."""

    def with_text(picture: re.Match[str]) -> str:
        if picture[2] not in drawn:
            return picture[0]
        sentence, _, _ = drawn[picture[2]].caption.partition(". ")
        return f"![{sentence.rstrip('.')}]({picture[1] or ''}{picture[2]}.png)"

    return re.sub(r"!\[[^\]]*\]\((docs/)?(\w+)\.png\)", with_text, text)


def words(name: str) -> str:
    return contents.filled(name, contents.numbers(stored("ensemble")))


def records(found: Sequence[Any], columns: Mapping[str, Column]) -> str:
    """Pipe table of stored records."""
    return table([*columns], [[column(record) for column in columns.values()] for record in found])


def verdicts(number: bool) -> list[Verdict]:
    """On published numbers, or on the claims; what is published twice stands once."""
    of_all = read_ledger(stored("claims")).verdicts.values()
    return [judged for judged in of_all if ("." in judged.id) == number and judged.is_shown]


def deciding(ranking: Mapping[str, Any]) -> str:
    """The unknowns that explain most of the variance alone, where that is above chance."""
    floor = ranking["noise_floor"]
    rows = [row for row in ranking["rows"] if row["index"] > max(row["half_width"], floor)]
    return ", ".join(f"`{row['name']}` {percent(row['index'])}" for row in rows[:3]) or "none above chance"


def shapes(reading: Mapping[str, Any], key: str) -> str:
    return " / ".join(str(shape[key]) for shape in reading["best_shape"])


def medians(ratio: ErrorRatio) -> str:
    """Median ratios of MAE on joints 2 and 3."""
    return " / ".join(contents.two_digits(median(ratio, joint)) for joint in (2, 3))


def share_of(ranking: RankingShares) -> str:
    """The share of stable plants on which a ranking holds in MAE and RMSE on both joints."""
    return percent(in_all_errors(ranking)["share"])


def likely(probability: float) -> str:
    """A probability; of a small one it counts that it is small."""
    return percent(probability) if probability >= 1e-4 else "below 0.01 %"


UNLIKE = 0.05
"""Share of plants left out that are less likely than the paper's ratios; below it none is like the paper."""


def given_the_tables() -> str:
    """The answer, the probability of each interpretation, and how well such a naming does where the truth is known."""
    given = stored("given")
    probability = dict(zip(given["names"], given["probability"], strict=True))
    found = sorted(zip(given["names"], given["plants"], np.diag(given["confused"]), strict=True),
                   key=lambda row: -probability[row[0]])
    rows = [
        (f"`{name}`", f"{plants:,}", likely(probability[name]), percent(right)) for name, plants, right in found
    ]
    bins = [
        (f"{held['low']:.2g} to {held['high']:.2g}", f"{held['plants']:,}", percent(held["probability"]),
         percent(held["right"]))
        for held in given["calibration"]
    ]
    left_out = ", ".join(f"`{name}`" for name in given["left_out"])
    parts = [
        verdict_on(given),
        table(
            ("group", "interpretations", "probability", "group named right on"),
            [(title, str(count), likely(held), percent(right)) for title, count, held, right in of_groups(given)],
        ),
        table(("interpretation", "stable plants", "probability", "named right on"), rows),
        f"Left out, with too few stable plants: {left_out}." if left_out else "",
        f"**How good is such a naming?** On plants that it has not seen it names the right interpretation on "
        f"{percent(given['accuracy'])}; chance would be {percent(1.0 / len(rows))}. It is sure, with a probability of "
        f"{percent(given['sure_from'])} or more, of {percent(given['sure'])} of them, and then right on "
        f"{percent(given['accuracy_when_sure'])}. Interpretations that hardly change the errors cannot be told apart.",
        table(("probability of the name", "plants left out", "on average", "right on"), bins),
    ]
    return "\n\n".join(part for part in parts if part)


def of_groups(given: Mapping[str, Any]) -> list[tuple[str, int, float, float]]:
    """Group, its interpretations, their probability, and the share of their plants that is named as one of them."""
    plants, confused = np.array(given["plants"]), np.array(given["confused"])
    found = []
    for title, names in GROUPS.items():
        own = np.array([name in names for name in given["names"]])
        right = np.average(confused[own][:, own].sum(axis=1), weights=plants[own]) if own.any() else math.nan
        found.append((title, int(own.sum()), float(np.array(given["probability"])[own].sum()), float(right)))
    return found


def verdict_on(given: Mapping[str, Any]) -> str:
    """Whether the published tables name an interpretation, or a group of them."""
    probability, name = max(zip(given["probability"], given["names"], strict=True))
    typical = f"Of the plants left out {percent(given['typical'])} have ratios less likely than the paper's."
    if given["typical"] < UNLIKE:
        return f"**None of them is like the paper.** {typical} The probabilities compare poor fits with each other."
    if probability >= given["sure_from"]:
        return f"**The tables name `{name}`**, with a probability of {percent(probability)}. {typical}"
    title, _, together, right = max(of_groups(given), key=lambda group: group[2])
    told = f"**The tables cannot tell which one is the paper's.** The most probable one, `{name}`, has {percent(probability)}."
    if together >= given["sure_from"]:
        told += (
            f" The group *{title}* together has {percent(together)}, where everything that the paper leaves open is as "
            f"likely as our ranges have it. Plants of that group are named as of it on {percent(right)}."
        )
    return f"{told} {typical}"


def begun_at(place: str) -> Column:
    """The misfit of the search of an interpretation that began at a place, if one did."""

    def column(held: Mapping[str, Any]) -> str:
        searches = [*stored("identify")["readings"], *stored("identify")["farther"]]
        found = [search for search in searches if (search["name"], search["begun_at"]) == (held["name"], place)]
        return off(found[0]["misfit_log"]) if found else ""

    return column


def off(misfit: float) -> str:
    """A misfit in per cent; one above 1 is of no stable plant."""
    return f"{100.0 * misfit:.1f} %" if misfit < 1.0 else "none stable"


def the_closest(found: Mapping[str, Any]) -> str:
    """Which plant is the closest that keeps every equation, whether a changed one is closer, and at what budget."""
    kept, changed = (nearest(found["readings"], names) for names in (KEPT, CHANGED))
    if not kept:
        return "No search has been stored."
    rows = [("every equation as published", kept)]
    scatter = float(np.std(kept["misfit_by_seed"], ddof=1)) if len(kept["misfit_by_seed"]) > 1 else 0.0
    if changed and changed["misfit_log"] < kept["misfit_log"] - scatter:
        rows.append(("an equation changed", changed))
    heads = ["closest plant with", *CLOSEST_PLANTS]
    cells = [(words, *(column(held) for column in CLOSEST_PLANTS.values())) for words, held in rows]
    if budget := found.get("budget"):
        effort = (
            f"Each interpretation had {budget['evaluations']:,} evaluations in {budget['seeds']} searches, over at most "
            f"{budget['unknowns']} unknowns. What was not searched stayed as it was where the search began. `make figures` draws "
            "the first plant (`--config closest`)."
        )
    else:
        lengths = [held["evaluations"] for held in found["readings"]]
        effort = f"These searches had different lengths, {min(lengths):,} to {max(lengths):,} evaluations."
    if not changed:
        judged = "No changed equation has been searched at this budget yet. The scatter of the searches is"
    elif len(rows) == 1:
        judged = "A changed equation comes no closer by more than the scatter of the searches,"
    else:
        judged = "A changed equation comes closer by more than the scatter of the searches,"
    searched = len({held["name"] for held in found["readings"]} & SHOWN.keys())
    if searched < len(SHOWN):
        effort += f" So far {searched} of {len(SHOWN)} interpretations have been searched."
    return f"{table(heads, cells)}\n\n{judged} {off(scatter)}. {effort}"


def at_their_best(laws: Sequence[Mapping[str, Any]]) -> str:
    """Median errors in deg with nothing known, by cap on roughness, velocity as measured and filtered."""
    caps = ("none", "1/3", "1/10", "1/30")
    rows = {
        (row["law"], row["filtered"], row["cap"]): f"{row['error_deg']:.3f}"
        for row in laws
        if row["knows"] == "none" and row["alpha"] is None and "error_deg" in row
    }
    found = [
        [law.title, *(rows.get((law.name, filtered, cap), "") for filtered in (False, True) for cap in caps)]
        for law in LAWS.values()
    ]
    found += [
        [f"Controller {k} as published", rows[f"controller_{k}", False, "published"], "", "", "",
         rows[f"controller_{k}", True, "published"], "", "", ""]
        for k in (1, 2, 3)
    ]
    return table(["controller", "no cap", *caps[1:], "filtered: no cap", *caps[1:]], found)


EXPERIMENTS_ON_STARTS = {
    "controllers_1_2": "Controller 1 over Controller 2",
    "controllers_1_2_late": "… without the first two seconds",
    "controllers_2_3": "Controller 2 over Controller 3",
    "controllers_2_3_late": "… without the first two seconds",
    "repeat": "Controller 1 repeated from another start",
    "half_speed": "Controller 1 at half the speed over full speed",
    "alpha_0.3": "Controller 1 with α = 0.3 over α = 0",
}
"""Experiments that tell starts and the reference's acceleration from changed equations."""
INTERPRETATIONS_OF_STARTS = {
    "printed": "as published",
    "reference_acceleration=absent": "acceleration not fed forward",
    "motion=ramp": "straight ramps",
    "starts=apart": "runs start apart",
    "motion=ramp+starts=apart": "ramps, start apart",
    "weights=extrapolating+Delta_unit=deg": "(1 + α, −α), Δ in degrees",
}


def experiments_on_starts() -> str:
    """Median and central 90 % of the ratio of errors of joint 2, by experiment and interpretation."""
    found = stored("predict_starts")
    ratios = {
        (row["experiment"], row["reading"]): f"{row['median']:.2f} ({row['low']:.2f} to {row['high']:.2f})"
        for experiment in found["experiments"]
        for row in experiment["ratios"]
        if row["joint"] == 2
    }
    return table(
        ["experiment", *INTERPRETATIONS_OF_STARTS.values()],
        [[label, *(ratios[name, reading] for reading in INTERPRETATIONS_OF_STARTS)]
         for name, label in EXPERIMENTS_ON_STARTS.items()],
    )


WHAT_RUNS = {
    "printed": "as published: each starts on its reference and gets its acceleration",
    "reference_acceleration=absent": "acceleration not fed forward",
    "motion=ramp": "straight ramps, which have none to feed forward",
    "starts=apart": "starts up to 2° from the reference",
    "motion=ramp+starts=apart": "… on straight ramps",
    "run_friction=drawn": "friction 0.7 to 1.4 times as large from run to run",
    STEPS: "a stored torque in steps of 0.016 N m, Δ in degrees",
    BOTH: "changed: weights (1 + α, −α) in Eq. (15), Δ in degrees",
}
"""Interpretations that README shows, and their words."""
RANKED = ("share_c1_worst", "share_c1_best", "share_c1_lt_c2_lt_c3")
"""Rankings of which README shows the shares."""


def what_it_depends_on() -> str:
    """How often Controller 1 is the worst or the best, and how near an arm comes, by what runs."""
    readings = contents.by_name(stored("ensemble"))
    misfits = {held["name"]: held["misfit_log"] for held in stored("identify")["readings"]}
    return table(
        ["what runs", "Controller 1 is the worst", "… the best", "published order", "the closest arm misses by"],
        [
            [words, *(share_of(readings[name][ranking]) for ranking in RANKED), off(misfits[name])]
            for name, words in WHAT_RUNS.items()
        ],
    )


READINGS: Mapping[str, Column] = {
    "interpretation": lambda held: f"`{held['name']}`",
    "plants": lambda held: f"{contents.stable_plants(held):,}",
    "order 1, 2, 3": lambda held: share_of(held["share_c1_lt_c2_lt_c3"]),
    "1 first": lambda held: share_of(held["share_c1_best"]),
    "1 last": lambda held: share_of(held["share_c1_worst"]),
    "… without 2 s": lambda held: share_of(held["without_start"]["share_c1_worst"]),
    "order 3, 2, 1": lambda held: share_of(held["share_c3_lt_c2_lt_c1"]),
    "1 over 2": lambda held: medians(held["ratio_c1_c2"]),
    "2 over 3": lambda held: medians(held["ratio_c2_c3"]),
    "1 smoothest": lambda held: percent(held["share_c1_smoother"]["share"]),
    "RMSE/MAE rises": lambda held: percent(held["share_rmse_over_mae_rises"]["both"]["share"]),
}
CLAIMS: Mapping[str, Column] = {
    "claim": lambda judged: judged.id,
    "the paper": contents.named,
    "here": contents.ours,
    "verdict": lambda judged: f"`{judged.verdict}`",
    "with another motion, start or friction": lambda judged: ", ".join(f"`{one.verdict}` with `{one.reading}`" for one in judged.unless),
    "interpretations with another verdict": lambda judged: str(len(judged.readings_that_change_it)),
}
NUMBERS = {**CLAIMS, "the paper": lambda judged: contents.named(judged).rpartition(": ")[2]}
CLOSEST_PLANTS: Mapping[str, Column] = {
    "interpretation": lambda held: f"`{held['name']}`",
    "misfit": lambda held: off(held["misfit_log"]),
    "begun at the arm": begun_at("arm"),
    "at the nearest draw": begun_at("draw"),
    "that draw itself": lambda held: off(stored("draws")["misfit_log"][held["name"]]),
    "of its seeds": lambda held: " to ".join(off(pick(held["misfit_by_seed"])) for pick in (min, max)),
    "unknowns": lambda held: str(len(held["rows_searched"])),
    "at a bound": lambda held: ", ".join(f"`{name}` {end}" for name, end in held["at_bound"].items()) or "none",
    "order in MAE, joint 2 / 3": lambda held: shapes(held, "ours_order_mae"),
    "in RMSE": lambda held: shapes(held, "ours_order_rmse"),
}
QUESTIONS: Mapping[str, Column] = {
    "first": lambda row: row["law"],
    "second": lambda row: row["over"],
    "first over second": lambda row: f"{row['median_ratio']:.2f}",
    "smaller": lambda row: str(row["smaller_error"]),
    "no difference": lambda row: str(row["no_difference"]),
    "larger": lambda row: str(row["larger_error"]),
    "undecided": lambda row: str(row["undecided"]),
    "verdict on the first": lambda row: row["verdict"],
}
MAKERS: Mapping[str, Callable[[], str]] = {
    "what it depends on": what_it_depends_on,
    "the headline": lambda: words("headline"),
    "the answer": lambda: f"{words('headline')}\n\n{words('answer')}",
    "why": lambda: words("why"),
    "robustness": lambda: table(contents.ROBUSTNESS_HEADS, contents.robustness(stored("ensemble"))),
    "readings": lambda: records(stored("ensemble")["populations"]["box"]["readings"], READINGS),
    "claims": lambda: records(verdicts(number=False), CLAIMS),
    "numbers": lambda: records(verdicts(number=True), NUMBERS),
    "deciding unknowns": lambda: table(
        ["of", "share of the variance that an unknown explains alone"],
        [(name, deciding(held)) for name, held in stored("decides").items()],
    ),
    "questions": lambda: records(stored("tune")["questions"], QUESTIONS),
    "at their best": lambda: at_their_best(stored("tune")["laws"]),
    "experiments on starts": experiments_on_starts,
    "given the tables": given_the_tables,
    "the closest": lambda: the_closest(stored("identify")),
    "closest plants": lambda: records(
        sorted(
            (held for held in stored("identify")["readings"] if held["name"] in SHOWN),
            key=lambda held: held["misfit_log"],
        ),
        CLOSEST_PLANTS,
    ),
}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        take(Path(sys.argv[1]))
    write_pages()
