"""Take stored results over from a reports folder, and write from them what docs are made of.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``: it writes ``docs/results``, the made
parts of findings.md and tables.md, and the pictures of findings.md. Without results it makes the pages again.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from given_tables import FOLDS, NOISE, SURE, given_tables
from pages import fresh, table

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.box import WORDS
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import published
from tendonrepro.configuration.shown import BOTH, CHANGED, GROUPS, KEPT, SHOWN, STEPS
from tendonrepro.evidence.figure_predictions import draw_predictions
from tendonrepro.identification.goal import printed_numbers
from tendonrepro.identification.nearest import nearest_draw
from tendonrepro.monte_carlo.data import EnsembleData, read_ensemble
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.monte_carlo.summary import RankingShares, ErrorRatio, in_all_errors, median
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.reporting import contents
from tendonrepro.reporting.contents import percent
from tendonrepro.reporting.figures import draw_map, draw_orders, draw_ranges
from tendonrepro.reporting.stored import thinned
from tendonrepro.results.figures.style import Drawing, save_drawing
from tendonrepro.tuning.figure import draw_tuning
from tendonrepro.tuning.laws import LAWS
from tendonrepro.verdicts.ledger import read_ledger
from tendonrepro.verdicts.verdict import Verdict

DOCS = Path(__file__).parent
RESULTS = DOCS / "results"
README = DOCS.parent / "README.md"
PAGES = (README, DOCS / "findings.md", DOCS / "predictions.md", DOCS / "tables.md", DOCS / "tune.md")
CLOSEST = DOCS.parent / "configs" / "closest.yaml"

Column = Callable[[Any], str]


# ---- from reports to docs/results --------------------------------------------------------------------------


def take(reports: Path) -> None:
    """Take results over from a reports folder."""
    RESULTS.mkdir(exist_ok=True)
    ledger = read(reports / "claims" / "claims.json")
    if (ledger.get("ensemble") or {}).get("source") != "local":
        sys.exit("these verdicts are the shipped ones; run tendonrepro claims again, beside the ensemble")
    summary = read(reports / "ensemble" / "summary.json")
    if read(reports / "claims" / "manifest.json").get("ensemble") != [summary["identity"], summary["draws"]]:
        sys.exit("these verdicts are of another ensemble; run tendonrepro claims again")
    store("ensemble.json", thinned(summary))
    ensemble = read_ensemble(reports / "ensemble")
    write("sample.json", sample_of(ensemble))
    store("given.json", given_record(ensemble, summary["draws"]))
    store("draws.json", nearest_draws(ensemble))
    store("claims.json", ledger)
    decides = read(reports / "claims" / "decides.json")
    store("decides.json", {name: held | {"rows": held["rows"][:5]} for name, held in decides.items()})
    if (reports / "compare").exists():
        for name in ("fig14", "samples"):
            shutil.copy(reports / "compare" / "figures" / f"{name}.png", DOCS)
    for folder in sorted(reports.glob("identify_all*")):
        take_closest(folder)
    if (reports / "closest").exists():
        if read(reports / "closest" / "manifest.json")["config"]["sha256"] != load_config("closest", "compare").sha256:
            sys.exit("reports/closest is of another plant; run tendonrepro compare --config closest --out reports/closest "
                     "--force, and make findings again")
        table2 = pd.read_csv(reports / "closest" / "tables" / "table2.csv")
        store("closest.json", table2[["run", "joint", "mae_deg", "rmse_deg"]].to_dict("records"))
    if (reports / "predict").exists():
        store("predict_starts.json", read(reports / "predict" / "predict.json"))
    if (reports / "tune").exists():
        found = read(reports / "tune" / "tune.json")
        kept = {key: value for key, value in found.items() if key != "by_plant"}
        store("tune.json", kept | {"tuned_over_published": tuned_over_published(found["by_plant"])})


def tuned_over_published(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Controller 2 tuned, over itself as published on the same arm: median error and roughness, by cap."""
    plain = [row for row in rows if row["stable"] and not row["filtered"] and row["knows"] == "none" and "alpha" not in row]
    published = {row["draw"]: row for row in plain if row["law"] == "controller_2"}
    found = {}
    for cap in ("none", "1/3"):
        pairs = [(row, published[row["draw"]]) for row in plain
                 if (row["law"], row["cap"]) == ("ntsm", cap) and row["draw"] in published]
        found[cap] = {key: float(np.median([ours[key] / theirs[key] for ours, theirs in pairs]))
                      for key in ("error", "roughness")}
    return found


SAMPLED = "encoder=ideal"
"""Interpretation of the sample: without encoder steps a run is not chaotic, so any machine gives its numbers."""
SAMPLE = 32
"""Plants of the sample, a second or two of work."""


def sample_of(ensemble: EnsembleData) -> dict[str, Any]:
    """First plants of an ensemble as drawn, to the last digit, and how each run ended: a test makes them again.

    Random noise depends on every row of the ranges, also on later ones. So plants with noise are left out.
    """
    of_row = dict(zip(ensemble.names, ensemble.draws.T, strict=True))
    noisy = (of_row["torque_noise_acts"] > 0.0) | (of_row["disturbance"] == WORDS["disturbance"].index("noise"))
    chosen = np.flatnonzero(~noisy)[:SAMPLE]

    def run_of(name: str) -> dict[str, Any]:
        status = [STATUSES[code] for code in ensemble.status(name, SAMPLED)[chosen]]
        sizes = {key: rounded(ensemble.statistic(name, SAMPLED, key)[chosen].tolist()) for key in ("mae", "rmse")}
        return {"status": status, **sizes}

    return {
        "reading": SAMPLED,
        "draws": {name: values[chosen].tolist() for name, values in of_row.items()},
        "runs": {name: run_of(name) for name in RUNS},
    }


def given_record(ensemble: EnsembleData, draws: int) -> dict[str, Any]:
    """How probable each interpretation shown is, given Tables 2 and 3, as plain values."""
    found = given_tables(ensemble, [name for name in SHOWN if name in ensemble.readings])
    plain = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in asdict(found).items()}
    return {"draws": draws, "noise": NOISE, "folds": FOLDS, "sure_from": SURE} | plain


def nearest_draws(ensemble: EnsembleData) -> dict[str, Any]:
    """How near the nearest draw of each interpretation shown comes to Tables 2 and 3, without any search."""
    goal = printed_numbers(published(), ensemble.joints)
    names = [name for name in SHOWN if name in ensemble.readings]
    return {"draws": len(ensemble), "misfit_log": {name: nearest_draw(ensemble, goal, name).misfit for name in names}}


BUDGET = ("generations", "population", "seeds", "evaluations", "unknowns", "rows", "ensemble_sha256")
"""What searches have to share to stand in one table: their effort, and the arm and ranges that they began with."""


def take_closest(folder: Path) -> None:
    """Add what `tendonrepro identify --fit all` found to what is stored, and ship the closest plant.

    It is the one that keeps every equation as published. Stored searches of another budget are left out; a smaller
    budget than the stored one is refused.
    """
    found = read(folder / "identify.json")
    found["ensemble_sha256"] = read(folder / "manifest.json")["config"]["ensemble_sha256"]
    budget = {key: found[key] for key in BUDGET}
    place = "draw" if "from_draws_of" in found else "arm"
    kept = ["name", "misfit_log", "misfit_by_seed", "seeds_agree", "rows_searched", "best_shape"]
    fresh = [
        {"physics_sha256": code_digest("physics"), "begun_at": place}
        | {key: reading[key] for key in kept}
        | {
            "unknowns": len(reading["rows_searched"]),
            "largest": max(reading["numbers"], key=lambda row: abs(math.log(row["ratio"]))),
            "at_bound": {row["name"]: row["at_bound"] for row in reading["parameters"] if row["at_bound"]},
        }
        for reading in found["readings"]
    ]
    before = stored("identify")
    if found["evaluations"] < before.get("budget", budget)["evaluations"]:
        sys.exit(f"the searches in {folder} are shorter than those that are stored; delete identify.json to start again")
    earlier = [*before["readings"], *before.get("farther", [])]
    if before.get("budget") != budget:
        print(f"leaving out {len(earlier)} stored searches of another budget or arm", file=sys.stderr)
        earlier = []
    searches = {(search["name"], search["begun_at"]): search for search in (*earlier, *fresh)}
    of_all = {key: found[key] for key in ("fit", "window")} | {"budget": budget}
    store("identify.json", of_all | by_nearness(list(searches.values())))
    best = nearest(stored("identify")["readings"], KEPT)
    if best and (best["name"], best["begun_at"]) in {(search["name"], place) for search in fresh}:
        text = (folder / "plants" / f"{best['name']}.yaml").read_text(encoding="utf-8")
        CLOSEST.write_text(f"# yaml-language-server: $schema=schema.json\n#\n{text}", encoding="utf-8")


def by_nearness(searches: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """The nearest search of each interpretation, and the others: a search begins at the arm, or at a draw."""
    best: dict[str, Mapping[str, Any]] = {}
    farther = []
    for search in sorted(searches, key=lambda search: search["misfit_log"]):
        if search["name"] in best:
            farther.append(search)
        else:
            best[search["name"]] = search
    return {"readings": list(best.values()), "farther": farther}


def begun_at(place: str) -> Column:
    """The misfit of the search of an interpretation that began at a place, if one did."""

    def column(held: Mapping[str, Any]) -> str:
        searches = [*stored("identify")["readings"], *stored("identify")["farther"]]
        found = [search for search in searches if (search["name"], search["begun_at"]) == (held["name"], place)]
        return off(found[0]["misfit_log"]) if found else ""

    return column


def nearest(readings: Sequence[Mapping[str, Any]], names: Collection[str]) -> Mapping[str, Any] | None:
    """The closest plant under some interpretations."""
    held = [reading for reading in readings if reading["name"] in names]
    return min(held, key=lambda reading: reading["misfit_log"], default=None)


def read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def stored(name: str) -> Any:
    """Stored results."""
    return read(RESULTS / f"{name}.json")


def store(name: str, content: Any) -> None:
    write(name, rounded(content))


def write(name: str, content: Any) -> None:
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    (RESULTS / name).write_text(text, encoding="utf-8")


def rounded(content: Any) -> Any:
    """Six digits are more than any of these numbers is worth, and keep the file small."""
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [rounded(value) for value in content]
    return float(f"{content:.6g}") if isinstance(content, float) else content


# ---- from docs/results to pages ----------------------------------------------------------------------------


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
    summary, found = stored("ensemble"), stored("predict")
    drawn = (
        draw_orders(summary),
        draw_map(summary, stored("closest")),
        draw_ranges(summary),
        draw_tuning(stored("tune")["laws"], {name: law.title for name, law in LAWS.items()}),
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
    if not (RESULTS / "given.json").exists():
        return "The stored ensemble has not been asked yet."
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
    "but": lambda judged: ", ".join(f"`{one.verdict}` with `{one.reading}`" for one in judged.unless),
    "other verdict under": lambda judged: str(len(judged.readings_that_change_it)),
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
    "the answer": lambda: words("answer"),
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
