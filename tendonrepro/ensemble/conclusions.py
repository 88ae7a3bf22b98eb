"""What a reader should conclude from an ensemble, in sentences made from its numbers alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tendonrepro.ensemble.report import percent, printed_reading, quantile_text
from tendonrepro.ensemble.shares import FEW, LEAST_PLANTS, MOST, RATIO_NAMES, RATIOS
from tendonrepro.results.summary import CONTROLLERS

CHANCE = 1.0 / 36.0
"""Share of an order of three laws that do not differ, MAE and RMSE going together, joints independent."""


def conclusions(populations: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Sentences on the ranking, the ratios, the readings and the statuses; the first population is judged."""
    summary = next(iter(populations.values()))
    lines = [_statuses(summary), *(_ranking(which, held) for which, held in populations.items())]
    lines += [_verdict(summary), *_ratios(summary), *_shape(summary), *_readings(summary)]
    return [line for line in lines if line]


def _share(share: Mapping[str, Any]) -> str:
    interval = "" if share["low"] is None else f"{percent(share['low'])} to {percent(share['high'])}, "
    return f"{percent(share['share'])} ({interval}{share['plants']} plants)"


def _statuses(summary: Mapping[str, Any]) -> str:
    status = printed_reading(summary)["status"]
    parts = [
        f"Controller {place} is ok on {percent(status[run]['ok']['share'])}, rings on "
        f"{percent(status[run]['ringing']['share'])}, diverges on {percent(status[run]['diverged']['share'])}"
        for place, run in enumerate(CONTROLLERS, start=1)
    ]
    unresolved = status[CONTROLLERS[0]]["unresolved"]["share"]
    return f"As printed, of the box: {'; '.join(parts)}. {percent(unresolved)} is too fast to be resolved."


def _ranking(name: str, summary: Mapping[str, Any]) -> str:
    reading, start = printed_reading(summary), f"Population {name}, as printed:"
    printed, reverse = (reading[key] for key in ("share_c1_lt_c2_lt_c3", "share_c3_lt_c2_lt_c1"))
    together = reverse["all_ok"]["mae_and_rmse"]["both"]
    if together["share"] is None:
        return f"{start} there is no plant on which all three laws are ok."
    few = f" Below {LEAST_PLANTS} plants that concludes nothing." * (together["plants"] < LEAST_PLANTS)
    last = [percent(order["diverged_last"]["mae_and_rmse"]["both"]["share"]) for order in (reverse, printed)]
    return (
        f"{start} in MAE and RMSE on both joints C3 < C2 < C1, the reverse of the printed order, holds on "
        f"{_share(together)} of the box where all three laws are ok, the printed order on "
        f"{_share(printed['all_ok']['mae_and_rmse']['both'])}; laws that do not differ would leave each "
        f"{percent(CHANCE)}.{few} With a diverged law ranked last, where not all three diverge, it is "
        f"{last[0]} and {last[1]}."
    )


def _verdict(summary: Mapping[str, Any]) -> str:
    reading = printed_reading(summary)
    printed, reverse = (
        reading[key]["all_ok"]["mae_and_rmse"]["both"]
        for key in ("share_c1_lt_c2_lt_c3", "share_c3_lt_c2_lt_c1")
    )
    if printed["share"] is None:
        return ""
    if printed["plants"] < LEAST_PLANTS:
        few = f"{printed['plants']} plants are too few to judge the printed ranking by"
        return f"{few}; {LEAST_PLANTS} are needed."
    if printed["share"] >= MOST:
        return "So the printed ranking follows from the printed equations on nearly every plant of the box."
    if reverse["share"] >= MOST:
        return (
            "So the printed equations imply the reverse ranking on nearly every plant of the box; the paper "
            "measured hardware, which may hold what the equations do not."
        )
    if printed["share"] <= FEW and reverse["share"] > 0.5:
        return (
            "So the printed equations give the printed ranking on next to no plant, and where all three laws "
            "are ok its complete reverse on most; the paper measured hardware, which may hold what the "
            "equations do not."
        )
    return "So which ranking the printed equations give depends on the plant, which the paper does not give."


def _ratios(summary: Mapping[str, Any]) -> list[str]:
    reading = printed_reading(summary)
    lines = []
    for key in RATIOS:
        for joint in summary["joints"]:
            ratio = reading[key]["all_ok"]["mae"][f"joint_{joint}"]
            if ratio["plants"] == 0:
                continue
            theory = ""
            if key == "ratio_c1_c2":
                theory = f"; errors that change slowly would give {reading['theory'][f'joint_{joint}']:.2f}"
            lines.append(
                f"As printed, {RATIO_NAMES[key]} in MAE on joint {joint}: median and central 90 % "
                f"{quantile_text(ratio)}; printed {ratio['printed']:.3f}{theory}."
            )
    return lines


def _shape(summary: Mapping[str, Any]) -> list[str]:
    """RMSE over MAE as printed, and the reading under which it rises most often as in the print."""
    reading, lines = printed_reading(summary), []
    for joint in summary["joints"]:
        sizes = [reading["rmse_over_mae"][run][f"joint_{joint}"] for run in CONTROLLERS]
        if sizes[0]["plants"]:
            ours = ", ".join(f"{size['median']['value']:.2f}" for size in sizes)
            printed = ", ".join(f"{size['printed']:.2f}" for size in sizes)
            lines.append(f"As printed, the median RMSE/MAE on joint {joint} is {ours}; printed {printed}.")
    counted = [
        one
        for one in summary["readings"]
        if one["share_rmse_over_mae_rises"]["both"]["plants"] >= LEAST_PLANTS
    ]
    if counted:
        best = max(counted, key=lambda one: float(one["share_rmse_over_mae_rises"]["both"]["share"]))
        share = _share(best["share_rmse_over_mae_rises"]["both"])
        lines.append(
            f"RMSE/MAE rises from Controller 1 to 3 on both joints most often under {best['name']}: {share}."
        )
        near = min(counted, key=lambda one: float(one["distance"]["median"]["value"]))
        closest = min(counted, key=lambda one: float(one["distance"]["lowest"]))
        printed = f", {reading['distance']['median']['value']:.3f} as printed" if reading in counted else ""
        lines.append(
            "What Table 2 says without a scale, ratios of MAE and RMSE/MAE, is missed least by the median "
            f"plant under {near['name']}: {near['distance']['median']['value']:.3f} (root mean square of "
            f"log(ours/printed)){printed}; the closest plant of all, {closest['distance']['lowest']:.3f}, is "
            f"under {closest['name']}."
        )
    return lines


def _readings(summary: Mapping[str, Any]) -> list[str]:
    by_verdict: dict[str, list[Mapping[str, Any]]] = {}
    for reading in summary["readings"]:
        by_verdict.setdefault(reading["agreement"]["verdict"], []).append(reading)
    agreeing, refuted = by_verdict.get("agrees", []), by_verdict.get("cannot", [])
    lines = []
    if agreeing:
        lines.append(
            f"All printed ratios lie inside the central 90 % under {_names(agreeing)}; "
            "the wider that is, the less it says."
        )
    elif by_verdict.keys() - {"no plant", "too few"}:
        lines.append("Under no reading do all printed ratios lie inside the central 90 %.")
    if refuted:
        rest = agreeing + by_verdict.get("in part", [])
        most = len(refuted) > len(rest)
        others = f"every reading with {LEAST_PLANTS} such plants or more but {_names(rest)}"
        under = others if most and rest else _names(refuted)
        lines.append(f"A printed ratio lies beyond every plant on which all three laws are ok under {under}.")
    if nothing := by_verdict.get("no plant"):
        lines.append(f"No plant keeps all three laws ok under {_names(nothing)}.")
    if rare := by_verdict.get("too few"):
        lines.append(f"Too few plants keep all three laws ok, to say anything, under {_names(rare)}.")
    return [*lines, _best(summary)]


def _best(summary: Mapping[str, Any]) -> str:
    def share(reading: Mapping[str, Any]) -> float:
        found = reading["share_c1_lt_c2_lt_c3"]["all_ok"]["mae_and_rmse"]["both"]
        return -1.0 if found["plants"] < LEAST_PLANTS else float(found["share"])

    best = max(summary["readings"], key=share)
    found = best["share_c1_lt_c2_lt_c3"]["all_ok"]["mae_and_rmse"]["both"]
    if found["plants"] < LEAST_PLANTS:
        return ""
    return (
        f"The printed order in MAE and RMSE on both joints is most frequent under {best['name']}: "
        f"{_share(found)}."
    )


def _names(readings: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(reading["name"] for reading in readings)
