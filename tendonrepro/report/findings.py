"""What the results say, in sentences: each is made of stored numbers, and left out where they do not bear it.

The text is Markdown of one line, for docs/findings.md and for the page alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tendonrepro.config.models.readings import PRINTED
from tendonrepro.config.published import published
from tendonrepro.ensemble.shares import FEW, MOST
from tendonrepro.physics.control import polynomial
from tendonrepro.report.answer import percent

LEAST_PLANTS = 100
"""Fewer say nothing, by the rules in docs/verdicts.md."""

_SIZES = ("table2", "table3.with")
_WEIGHTS = "weights=extrapolating"
_BOTH = f"phi_branch=power+{_WEIGHTS}"
_STORED = "stored_torque=applied+output_delay=1"
_MOTOR = "feedback=motor"


@dataclass(frozen=True)
class Results:
    """An ensemble, thinned by `rows.thinned`, its ledger as in ``claims --json``, and what decides claims."""

    summary: Mapping[str, Any]
    ledger: Mapping[str, Any]
    decides: Mapping[str, Any]

    @property
    def plants(self) -> int:
        """Plants drawn."""
        return int(self.summary["populations"]["box"]["plants"])

    @property
    def readings(self) -> dict[str, Mapping[str, Any]]:
        """Readings of the box by name."""
        return {reading["name"]: reading for reading in self.summary["populations"]["box"]["readings"]}

    @property
    def entries(self) -> dict[str, Mapping[str, Any]]:
        """Entries of the ledger by id."""
        return {entry["id"]: entry for entry in self.ledger["claims"]}

    def starting(self, *starts: str) -> list[Mapping[str, Any]]:
        """Entries whose id starts with one of these."""
        return [entry for name, entry in self.entries.items() if name.startswith(starts)]


def findings(found: Results) -> list[str]:
    """What a reader should take away, the strongest first; a bold sentence and its reasons each."""
    makers = (
        _order,
        _ratios,
        _mended,
        _other_ways,
        _encoders,
        _sizes,
        _shape,
        _torque,
        _parts,
        _others,
        _kinematics,
    )
    return [text for maker in makers if (text := maker(found))]


def why(ours: Mapping[str, float]) -> list[str]:
    """Say why the plant hardly matters for the order of the laws; `ours` are numbers of a run, by id."""
    paper = published()
    alpha, beta, eta, b, Delta = (
        [paper.number(f"gain.{name}.joint_{joint}") for joint in (2, 3)]
        for name in ("alpha", "beta", "eta", "b", "Delta")
    )
    slope = eta[0] * polynomial(b[0], Delta[0])[0]
    first, both = (
        [ours.get(f"share.controller_1_of_{rival}.mae.joint_{joint}", math.nan) for joint in (2, 3)]
        for rival in (2, 3)
    )
    softer = [two / one for one, two in zip(first, both, strict=True)]
    age, soft = (
        "" if math.isnan(sum(values)) else f" The run of this page gives {values[0]:.2f} and {values[1]:.2f}."
        for values in ([value / 100.0 for value in first], softer)
    )
    return [
        "The α-TDE of Eq. (15) is a mean of the estimate one period old and the one two periods old. Where H changes slowly "
        "that is an estimate (1 + α) L old, and the error grows by 1 + α: "
        f"{1.0 + alpha[0]:.1f} and {1.0 + alpha[1]:.1f} on joints 2 and 3 for the printed α, Controller 1 over Controller 2.{age}",
        f"Inside Δ = {Delta[0]:g} rad = {math.degrees(Delta[0]):.1f}° the printed φ is its polynomial, with the slope "
        f"η γ₁ = {slope:.2f}. Controller 3 has β = {beta[0]:g}. So Controllers 1 and 2 are the softer ones, and slow errors of "
        f"Controller 2 over those of Controller 3 are {beta[0] / slope:.2f}.{soft}",
        "The plant cancels in both ratios as long as the loop is well damped, the load changes slowly, the joint does not stick and an "
        "encoder count is small against the error.",
    ]


def interval(share: Mapping[str, Any]) -> str:
    """Share and its interval, where it has one."""
    if share["share"] is None or share["low"] is None:
        return percent(share["share"])
    return f"{percent(share['share'])} [{percent(share['low'])}, {percent(share['high'])}]"


def _mostly(share: Mapping[str, Any]) -> bool:
    """Whether a statement holds on more than half of enough plants, whatever the draws."""
    return share["plants"] >= LEAST_PLANTS and (share["low"] or 0.0) > 0.5


def _order(found: Results) -> str | None:
    printed, entry = found.readings["printed"], found.entries["C2"]
    forth, back = printed["in_order"], printed["in_reverse"]
    if back["plants"] < LEAST_PLANTS:
        return (
            f"**About the order of the laws this ensemble says nothing.** As printed all three track on {back['plants']} of the "
            f"{found.plants} plants drawn, and fewer than {LEAST_PLANTS} conclude nothing."
        )
    head = "As printed, the equations give no one order of the laws."
    if _mostly(back):
        head = "As printed, the equations mostly rank the laws the other way round."
    elif _mostly(forth):
        head = "As printed, the equations mostly rank the laws as the paper does."
    text = (
        f"**{head}** On {interval(back)} of the {back['plants']} plants on which all three laws track, out of {found.plants} drawn, "
        f"the complete order is 3, 2, 1, in MAE and RMSE on both joints; the printed order 1, 2, 3 holds on {interval(forth)}. "
        "Laws that do not differ would give 2.8 % each."
    )
    text += f" {_ranked_last(printed)}."
    firm = _firm(found)
    if firm and firm["in_reverse"]["plants"] >= LEAST_PLANTS:
        text += (
            f" On the firm rows it is {percent(firm['in_reverse']['share'])} of the {firm['in_reverse']['plants']} plants on which all "
            f"track; {_ranked_last(firm)[0].lower()}{_ranked_last(firm)[1:]}."
        )
    slips = ("phi_negative=even", "eta_in_controller_2=dropped")
    left = [found.readings.get(name) for name in (*slips, "+".join(slips))]
    if all(left):
        one, other, both = (percent(held["in_reverse"]["share"]) for held in left if held)
        text += (
            ' "As printed" mends two [slips](slips.md), that φ is not odd and that Controller 2\'s law lacks η; with either left '
            f"as it stands it is {one} and {other}, with both {both}.{_silent(found)}"
        )
    above = [row for row in entry["evidence"].get("statements", ()) if row["share"] > FEW]
    if len(above) == 1 and entry["verdict"] == "depends_on_plant" and _mostly(back):
        text += (
            f" Claim C2 is not called `contradicted` only because one of its statements, {_law(above[0]['statement'])}, holds on "
            f"{percent(above[0]['share'])}; the limit is {percent(FEW)}."
        )
        later = entry["evidence"]["diverged_last"]["statements"]
        text += f" With a diverged law ranked last {sum(row['share'] > FEW for row in later)} of the {len(later)} are above it."
    return text + " [Why the plant hardly matters](#why-the-plant-hardly-matters)."


def _ranked_last(reading: Mapping[str, Any]) -> str:
    back, forth = (reading["diverged_last"][key] for key in ("in_reverse", "in_order"))
    return (
        f"Of the {back['plants']} on which not all three diverge, a diverged law ranked last, it is {percent(back['share'])} and "
        f"{percent(forth['share'])}"
    )


def _silent(found: Results) -> str:
    """What becomes of the reverse order under other choices where the print is silent, one at a time."""
    single = {name: held["in_reverse"] for name, held in found.readings.items() if _is_silent(name)}
    enough = {name: share for name, share in single.items() if share["plants"] >= LEAST_PLANTS}
    kept = [share["share"] for share in enough.values() if share["share"] > 0.5]
    lost = [
        f"`{name}` ({percent(share['share'])})" for name, share in enough.items() if share["share"] <= 0.5
    ]
    none = [f"`{name}`" for name, share in single.items() if not share["plants"]]
    if not kept:
        return ""
    text = (
        f" It also includes our choices where the print is silent: with another one, one at a time, the reverse order holds on "
        f"{_from_to(kept)} under {len(kept)} readings"
    )
    text += f", but not under {' and '.join(lost)}" if lost else ""
    return text + (f"; on no plant all three track under {' and '.join(none)}." if none else ".")


def _is_silent(name: str) -> bool:
    """Whether a reading changes one choice where the print says nothing."""
    return "+" not in name and not name.startswith(
        ("phi_", "weights", "eta_", "differencing", "encoder", PRINTED)
    )


def _firm(found: Results) -> Mapping[str, Any] | None:
    """What the firm rows of the box give as printed."""
    readings = found.summary["populations"].get("firm", {"readings": []})["readings"]
    return next((held for held in readings if held["name"] == PRINTED), None)


def _law(statement: str) -> str:
    """Statement of a claim in a sentence."""
    return statement.replace("controller_", "Controller ")


def _ratios(found: Results) -> str | None:
    printed = found.starting("share.")
    against = [entry for entry in printed if entry["verdict"] == "contradicted"]
    ratio = found.readings["printed"]["c1_c2"]["joint_2"]
    if not against or ratio["median"] is None:
        return None
    head = "So the printed ratios are contradicted where all three laws track"
    if len(against) < len(printed):
        head = (
            f"{len(against)} of the {len(printed)} printed ratios are contradicted where all three laws track"
        )
    first, second = (float(found.entries[f"table2.controller_{k}.mae.joint_2"]["printed"]) for k in (1, 2))
    text = (
        f"**{head}.** Controller 1's MAE over Controller 2's on joint 2 is {ratio['median']:.2f}, {ratio['q05']:.2f} to "
        f"{ratio['q95']:.2f} on the central 90 % of the plants; the print has {first / second:.2f}."
    )
    drawn = [entry for entry in against if "hardware=drawn" not in entry["readings_that_change_it"]]
    last = [entry for entry in against if "ranked last" not in " ".join(entry["evidence"].get("remarks", ()))]
    if "hardware=drawn" in found.readings:
        text += (
            f" With encoder, output delay and filter as drawn the verdict stands for {len(drawn) or 'none'} of the {len(against)}"
            f"{_overturned(found, against)}, with a diverged law ranked last for {len(last) or 'none'}"
        )
        ahead = [
            entry["evidence"]["direction"]["diverged_last"]["share"] for entry in against if entry not in last
        ]
        text += f": there Controller 1 is ahead on {_from_to(ahead)}." if ahead else "."
    return text + " They are one statement, that Controller 1 errs less, in several numbers."


def _overturned(found: Results, against: Sequence[Mapping[str, Any]]) -> str:
    """Single silent choices with which the verdict stands for none of the entries."""
    changing = set.intersection(*(set(entry["readings_that_change_it"]) for entry in against))
    names = [f"`{name}`" for name in found.readings if name in changing and _is_silent(name)]
    return f", for none with {' or '.join(names)}" if names else ""


def _from_to(shares: Sequence[float]) -> str:
    low, high = percent(min(shares)), percent(max(shares))
    return low if low == high else f"{low} to {high}"


def _mended(found: Results) -> str | None:
    readings = found.readings
    enough = [held for held in readings.values() if held["in_order"]["plants"] >= LEAST_PLANTS]
    both = readings.get(_BOTH)
    if both is None or not _mostly(both["in_order"]):
        best = max(enough, key=lambda held: held["in_order"]["share"], default=None)
        if best is None or _mostly(best["in_order"]):
            return None
        return (
            f"**No reading that was run brings the printed order back on most plants.** Of {len(readings)} the best is "
            f"`{best['name']}`, with {interval(best['in_order'])} of {best['in_order']['plants']} plants."
        )
    alone = readings.get(_WEIGHTS)
    if alone and _mostly(alone["first_best"]) and not _mostly(alone["in_order"]):
        text = (
            f"**Extrapolating weights put Controller 1 first on {'nearly every plant' if _nearly(alone) else 'most plants'} that all three laws "
            "track; for the printed order on most of them φ has to change too.** Under weights (1 + α, −α) its "
            f"errors are the smallest on {interval(alone['first_best'])} of {alone['first_best']['plants']} plants, where as printed it is "
            f"{percent(readings['printed']['first_best']['share'])}. That is what the paper claims in words; Controller 3 stays before 2. "
            f"With a diverged law ranked last it is {percent(alone['diverged_last']['first_best']['share'])} of "
            f"{alone['diverged_last']['first_best']['plants']}{_in_degrees(found)}. "
            "With the power branch of φ near zero as well the printed order holds on "
        )
    else:
        text = (
            "**Two other readings together bring the order back**: weights (1 + α, −α) and the power branch of φ near zero. They give "
            "the printed order on "
        )
    last = both["diverged_last"]["in_order"]
    text += (
        f"{interval(both['in_order'])} of {both['in_order']['plants']} plants ({percent(last['share'])} of {last['plants']} with a diverged law "
        "ranked last)"
    )
    motors = readings.get(f"{_BOTH}+{_MOTOR}")
    if motors:
        text += (
            f", with motor-side feedback on {interval(motors['in_order'])} of {motors['in_order']['plants']}"
        )
    rise, smooth = (
        max(held[key]["share"] for held in enough) for key in ("order_and_rise", "order_and_smoother")
    )
    text += (
        '. Eq. (15) and the "weighted average" of section 5.3 exclude the first; Eq. (12) has the second only where its surface is '
        f"exactly zero. They were found by trying {len(readings)} readings."
    )
    if both["inside"] < len(found.starting("share.")):
        text += f" Not all comes back: {both['inside']} of the 8 printed ratios lie in the central 90 %, and RMSE/MAE rises as printed "
        text += f"on {percent(both['rmse_over_mae_rises']['share'])}."
    ok, printed = [percent(both["ok"][f"controller_{k}"]) for k in (1, 2, 3)], readings["printed"]["smoother"]
    fewer = both["ok"]["controller_1"] < min(both["ok"][f"controller_{k}"] for k in (2, 3))
    if _mostly(printed) and both["smoother"]["share"] < 0.5 and fewer:
        text += (
            f" And it costs what agrees as printed: with encoders on the joints Controller 1's torque is the smoothest on {percent(both['smoother']['share'])} instead "
            f"of {percent(printed['share'])}, and it tracks on fewer plants than the others, {ok[0]} against {ok[1]} and {ok[2]}."
        )
    return text + (
        f" No reading that was run gives the printed order with that rise on more than {percent(rise)} of the plants, or with the "
        f"smoothest torque on more than {percent(smooth)}."
    )


def _nearly(reading: Mapping[str, Any]) -> bool:
    return float(reading["first_best"]["share"]) >= MOST


def _in_degrees(found: Results) -> str:
    """A silent choice on which the lead of Controller 1 under other weights hangs."""
    held = found.readings.get(f"{_WEIGHTS}+gain_unit=phi_in_degrees")
    if held is None or held["first_best"]["plants"] < LEAST_PLANTS or held["first_best"]["share"] > 0.5:
        return ""
    return f", with φ in degrees {percent(held['first_best']['share'])} of {held['first_best']['plants']}"


def _other_ways(found: Results) -> str | None:
    """Readings with the printed weights under which Controller 1 is first, and plants on which all comes back."""
    first = [
        held
        for name, held in found.readings.items()
        if "weights" not in name and max(map(_judged, _firsts(held))) > 0.5
    ]
    whole = {
        name: round(held["order_rise_and_smoother"]["share"] * held["order_rise_and_smoother"]["plants"])
        for name, held in found.readings.items()
        if held["order_rise_and_smoother"]["share"]
    }
    if not first:
        return None
    text = (
        f"**With the weights of Eq. (15) Controller 1 comes first under {len(first)} of the readings, by one count or the other.** It has the "
        "smallest errors"
    )
    for held in sorted(first, key=lambda held: -float(held["diverged_last"]["first_best"]["share"])):
        best, last = _firsts(held)
        text += f" under `{held['name']}` on {percent(last['share'])} of {last['plants']} plants with a diverged law ranked last"
        if best["plants"] < LEAST_PLANTS:
            text += f", while all three laws track on {best['plants'] or 'none'};"
            continue
        text += (
            f" and on {percent(best['share'])} of the {best['plants']} that all three track (there the printed order on "
            f"{percent(held['in_order']['share'])}, the smoothest torque on {percent(held['smoother']['share'])}, C1/C2 in MAE on joint 2 "
            f"from {held['c1_c2']['joint_2']['q05']:.2g} to {held['c1_c2']['joint_2']['q95']:.2g});"
        )
    text = f"{text[:-1]}."
    if whole:
        cases = ", ".join(
            f"{count} of {found.readings[name]['in_order']['plants']} under `{name}`"
            for name, count in sorted(whole.items(), key=lambda pair: -pair[1])
        )
        text += (
            " Single plants have the printed order, the rise of RMSE/MAE on both joints and the smoothest torque of Controller 1 "
            f"together, of all readings: {cases}."
        )
    return text


def _firsts(held: Mapping[str, Any]) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Shares on which Controller 1 is first: where all track, and with a diverged law ranked last."""
    return held["first_best"], held["diverged_last"]["first_best"]


def _judged(share: Mapping[str, Any]) -> float:
    return float(share["share"]) if share["plants"] >= LEAST_PLANTS else 0.0


def _encoders(found: Results) -> str | None:
    readings = found.readings
    if _MOTOR not in readings:
        return None
    tracking = {name: held["in_order"]["plants"] for name, held in readings.items()}
    if tracking[_MOTOR] < max(count for name, count in tracking.items() if _MOTOR not in name):
        return None
    damping = found.decides.get("C1", {"rows": [{"name": ""}]})["rows"][0]["name"].startswith(
        "tendon_damping"
    )
    text = (
        "**With encoders on the motors the laws track most often.** With those on the joints all three "
        f"track on {percent(tracking['printed'] / found.plants)} of the plants drawn"
        f"{', which hangs on the damping of a tendon more than on any other single unknown' * damping}; with those of the motors on "
        f"{percent(tracking[_MOTOR] / found.plants)}, where the errors leave out the tendons' stretch."
    )
    if tracking.get("encoder=ideal", found.plants) < 0.5 * tracking[_MOTOR]:
        text += f" Counting finer does not do it alone: ideal ones on the joints give {percent(tracking['encoder=ideal'] / found.plants)}."
    if _mostly(readings[_MOTOR]["in_reverse"]) and _mostly(readings["printed"]["in_reverse"]):
        text += f" With the motors' the order is reversed too, on {interval(readings[_MOTOR]['in_reverse'])}."
    return text + " The paper's loops were stable, and its section 5.2 speaks for encoders on the joints."


def _sizes(found: Results) -> str | None:
    sizes = found.starting(*_SIZES)
    power = [entry["evidence"].get("also_passing") for entry in sizes]
    if None in power or min(power) < 0.5 or {entry["verdict"] for entry in sizes} != {"compatible"}:
        return None
    near = found.readings[PRINTED]["reverse_near_print"]
    text = (
        f"**The sizes of the errors say nothing.** All {len(sizes)} numbers of Tables 2 and 3 lie inside the central 90 % of those plants (the loaded ones of those on which that run tracks too), and so would "
        f"{percent(min(power))} to {percent(max(power))} of a decade around each. Only orders and ratios can be tested without "
        "the plant."
    )
    if near["plants"] >= LEAST_PLANTS:
        others = [
            held["reverse_near_print"]["share"]
            for name, held in found.readings.items()
            if held["reverse_near_print"]["plants"] >= LEAST_PLANTS and _is_silent(name)
        ]
        text += (
            " Where all six MAE of the three laws are within a factor of 2 of the print (a bound chosen after results) the complete reverse "
            f"order holds on {interval(near)} of {near['plants']}"
        )
        text += f", under other choices where the print is silent on {_from_to(others)}" if others else ""
        firm = _firm(found)
        text += (
            f"; of the firm rows {firm['reverse_near_print']['plants'] or 'no'} plants are that near."
            if firm
            else "."
        )
    return text


def _shape(found: Results) -> str | None:
    boxes = [found.entries[f"rmse_over_mae.controller_{k}.joint_2"]["evidence"].get("box") for k in (1, 2, 3)]
    share = found.entries["F1"]["evidence"].get("share")
    if not all(boxes) or share is None or share > 0.5:
        return None
    ours = [box["median"] for box in boxes if box]
    theirs, others = _printed_shapes(2), _printed_shapes(3)
    printed, growth, farther = found.readings["printed"], theirs[2] / theirs[0], others[2] / others[0]
    reach = [name for name, held in found.readings.items() if _reaches(held, growth)]
    singly = {entry["verdict"] for entry in found.starting("rmse_over_mae.")} == {"compatible"}
    text = (
        "**One clue that needs no scale is not explained.** RMSE over MAE on joint 2 rises over Controllers 1 to 3 in the print, "
        f"{_listed(theirs)}; here the medians are {_listed(ours)}. {'Singly all eight RMSE/MAE lie inside. ' * singly}But from 1 to 3 it "
        f"grows by {percent(growth - 1.0)} in print, on no plant by more than {_growth(printed, 2)}; on joint 3 by "
        f"{percent(farther - 1.0)} in print, here by up to {_growth(printed, 3)}"
    )
    held = _firm(found)
    if held and held["rmse_over_mae_rises"]["plants"] >= LEAST_PLANTS:
        text += (
            f" ({_growth(held, 3)} on the firm rows). How often it rises at all, on both joints, hangs on the least known unknowns: on "
            f"{percent(share)} of the box and {percent(held['rmse_over_mae_rises']['share'])} of its firm rows, by chance on 2.8 %"
        )
    else:
        text += f". It rises at all, on both joints, on {percent(share)} of the plants, by chance on 2.8 %"
    if reach:
        middle = max(found.readings[name]["growth"]["joint_2"]["median"] for name in reach) - 1.0
        text += f". Under {len(reach)} other readings some plants reach the growth on joint 2, no median is above {percent(middle)}"
    return text + "."


def _growth(reading: Mapping[str, Any], joint: int) -> str:
    """Largest growth of RMSE/MAE from Controller 1 to 3 on any plant."""
    return percent(reading["growth"][f"joint_{joint}"]["highest"] - 1.0)


def _printed_shapes(joint: int) -> list[float]:
    """RMSE/MAE of Controllers 1 to 3 as printed."""
    paper = published()
    mae, rmse = (
        [paper.number(f"table2.controller_{k}.{metric}.joint_{joint}") for k in (1, 2, 3)]
        for metric in ("mae", "rmse")
    )
    return [root / mean for mean, root in zip(mae, rmse, strict=True)]


def _reaches(reading: Mapping[str, Any], growth: float) -> bool:
    """Whether a plant has the printed growth of RMSE/MAE on joint 2."""
    highest = reading["growth"]["joint_2"]["highest"]
    return highest is not None and reading["in_order"]["plants"] >= LEAST_PLANTS and highest >= growth


def _torque(found: Results) -> str | None:
    entries, printed = found.entries, found.readings["printed"]
    steps = [
        held["share"]
        for held in entries["C6"]["evidence"].get("statements", ())
        if "torque step" in held["statement"]
    ]
    measured = {held["measure"]: held["share"] for held in entries["E1"]["evidence"].get("by_measure", ())}
    ok = [printed["ok"][f"controller_{k}"] for k in (1, 2, 3)]
    if not steps or min(steps) <= 0.5 or not measured or not ok[0] > max(ok[1:]):
        return None
    where = "every plant judged" if min(steps) == 1.0 else f"at least {percent(min(steps))}"
    one, two, three = map(percent, ok)
    text = (
        f"**What agrees with the print about α:** the torque is smoother on {where}, and Controller 1 tracks on more of the plants "
        f"drawn, {one} against {two} and {three} of Controllers 2 and 3{_robustness(found)}. Its estimate is better on both joints on "
        f"{percent(measured['RMS of epsilon'])} by the RMS of its error and on {percent(measured['RMS of epsilon below 3 Hz'])} by what of it "
        "lies below 3 Hz, by chance on 25 %"
    )
    beside = [
        row["share"] for row in entries["E1"]["evidence"].get("beside", ()) if "both" in row["statement"]
    ]
    if len(beside) == 2:
        text += f"; with an ideal encoder on {percent(beside[0])} and {percent(beside[1])}, which counts do not shake"
    stored = found.readings.get(_STORED)
    if stored and stored["ok"]["controller_1"] > 2.0 * max(stored["ok"][f"controller_{k}"] for k in (2, 3)):
        one, two, three = (percent(stored["ok"][f"controller_{k}"]) for k in (1, 2, 3))
        text += f". Where the law stores the torque applied, a sample late, α decides: Controller 1 tracks on {one}, 2 and 3 on {two} and {three}"
    return f"{text}."


def _parts(found: Results) -> str | None:
    """What C5 and C6 ask for, part by part: the least and the largest share over joints and rivals."""

    def shares(claim: str, measure: str, *words: str) -> list[float]:
        held = found.entries[claim]["evidence"].get("statements", ())
        rows = (row for row in held if row.get("measure") == measure)
        return [row["share"] for row in rows if all(word in row["statement"] for word in words)]

    smaller = {
        measure: shares("C5", measure, "moving up") + shares("C6", measure, "of torque of controller_1 below")
        for measure in ("RMS", "peak", "course below 3 Hz")
    }
    measures = tuple(smaller)
    down = [shares("C5", measure, "moving down") for measure in measures]
    far = {
        joint: [shares("C6", measure, "moving up", f"joint {joint}") for measure in measures]
        for joint in (2, 3)
    }
    if not all((*smaller.values(), *down, *far[2], *far[3])):
        return None

    def each(found: Sequence[Sequence[float]]) -> str:
        return ", ".join(map(_from_to, found))

    return (
        f'**C5 and C6, part by part,** by RMS, by peak and by course below 3 Hz, least to most over joints and rivals: "smaller" holds on '
        f'{each(list(smaller.values()))}; "similar moving down" on {each(down)}; "significantly smaller moving up" on joint 2 on '
        f"{each(far[2])}, on joint 3 on {each(far[3])}."
    )


def _others(found: Results) -> str | None:
    """What holds of the sampling period, of M_bar and of the payload."""
    period, inertia, payload = (found.entries[name]["evidence"] for name in ("E2", "E2a", "P1"))
    measured = {held["measure"]: held["share"] for held in period.get("by_measure", ())}
    ways = ("MAE, {}", "RMS of epsilon below 3 Hz, {}")
    error, estimate = (
        [measured.get(way.format(name)) for name in ("ideal encoder", "encoder as printed")] for way in ways
    )
    cost = next(
        (text for text in period.get("remarks", ()) if text.startswith("Controller 2 is ok on")), None
    )
    shares = (*error, inertia.get("share"), payload.get("share"))
    if cost is None or None in estimate or any(share is None or share <= 0.5 for share in shares):
        return None
    return (
        f"**What else agrees:** a smaller L gives a smaller tracking error on {percent(error[0])} of {period['plants']} plants with an ideal "
        f"encoder and on {percent(error[1])} with the printed one; the estimate itself, below 3 Hz, gets better on {percent(estimate[0])} and "
        f"{percent(estimate[1])}. The price: {cost.partition(':')[0]}. A smaller M̄ gives a calmer torque on {percent(inertia['share'])}. The payload "
        f"makes every error larger on {percent(payload['share'])}. Much of this could [hardly have failed](verdicts.md#power)."
    )


def _robustness(found: Results) -> str:
    evidence = found.entries.get("E1a", {"evidence": {}})["evidence"]
    if evidence.get("share") is None or evidence["share"] <= 0.5:
        return ""
    low, high = evidence["interval"] or (None, None)
    others = len(found.entries["E1a"]["readings_that_change_it"])
    return (
        f"; of the {evidence['plants']} on which just one of 1 and 2 does, it is 1 on "
        f"{interval({'share': evidence['share'], 'low': low, 'high': high})} (another verdict under {others} other readings)"
    )


def _kinematics(found: Results) -> str | None:
    verdicts = [found.entries[name]["verdict"] for name in ("K1", "K2", "K2a", "K2b")]
    if verdicts != ["exact", "reproduced", "not_reproduced", "not_reproduced"]:
        return None
    return (
        "**In magnitude S and its inverse follow from Table 1**, to the printed digits. The description of Fig. 6 does not follow from Eq. (1) with "
        "section 3.3's signs."
    )


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
