"""Pictures of a stored ensemble: the answer in six rows, and how the controllers rank under each reading."""

from __future__ import annotations

import numpy as np

from tendonrepro.configuration.models.readings import BOTH, GROUPS, PRINTED, STARTS_APART, STEPS
from tendonrepro.monte_carlo.shares import printed_ratios
from tendonrepro.reporting.contents import Row, Shown
from tendonrepro.results.figures import style
from tendonrepro.verdicts.words import percent

ANSWER = {
    PRINTED: ("as published: same start, same friction", "#004488"),
    "reference_acceleration=absent": ("acceleration not fed forward", "#004488"),
    STARTS_APART: ("each run starts up to 2° off", "#5B93CC"),
    "run_friction=drawn": ("friction 0.7 to 1.4 times, run to run", "#5B93CC"),
    STEPS: ("stored torque in 0.016 N m steps, Δ in degrees", "#5B93CC"),
    BOTH: ("changed: a sign of Eq. (15), Δ in degrees", "#555555"),
}
"""Interpretations of `draw_answer`, each with its label and colour: all alike, something differs, changed."""
_PAPER = "#B5405A"
"""Colour of the paper's number."""
_ANSWER_RATIO = (0.5, 1.72)
"""Ends of the axis of `draw_answer`."""


@style.journal_style()
def draw_answer(shown: Shown) -> style.Drawing:
    """Draw the mean error of joint 2, Controller 1 over Controller 2, in the rows of `ANSWER`."""
    figure = style.open_figure(style.PAGE_MM, 74.0)
    panel = figure.subplots()
    rows = [(shown.box[name], *row) for name, row in ANSWER.items() if name in shown.box]
    (paper,) = printed_ratios((0, 1), "mae", [2])
    panel.axvspan(_ANSWER_RATIO[0], 1.0, color="#E4EAF1", linewidth=0.0, zorder=0.0)
    panel.axvline(1.0, color="#888888", linewidth=0.8)
    panel.axvline(paper, color=_PAPER, linewidth=1.4, linestyle=(0.0, (4.0, 2.0)))
    for place, (row, _, colour) in enumerate(rows):
        ends = [row["c1_c2_joint_2_q05"], row["c1_c2_joint_2_q95"]]
        panel.plot(ends, [place] * 2, color=colour, linewidth=4.0, solid_capstyle="butt")
        look: style.Look = {"markersize": 6.0, "mfc": "white", "mec": colour, "mew": 1.6, "zorder": 3.0}
        panel.plot([row["c1_c2_joint_2_median"]], [place], "o", **look)
        style.mark_cut(panel, (ends[0], ends[1]), place, _ANSWER_RATIO, colour)
    panel.set(xscale="log", xlim=_ANSWER_RATIO, ylim=(len(rows) - 0.5, -1.2))
    ticks = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6)
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()
    panel.set_xlabel(
        "mean error of joint 2: Controller 1 (α-TDE) over Controller 2 (TDE)\n"
        "bars: central 90 % of the stable arms, rings: medians"
    )
    counts = [f"{percent(row['behind'])} of {row['plants']:,.0f}" for row, _, _ in rows]
    right = panel.secondary_yaxis("right")
    right.set_yticks([-0.8, *range(len(rows))], ["it is worse on", *counts])
    panel.set_yticks(range(len(rows)), [label for _, label, _ in rows])
    for axis in (panel, right):
        axis.tick_params("y", length=0.0)
        axis.spines[["left", "right", "top"]].set_visible(False)
    panel.text(paper, -0.8, f"paper, one run each: {paper:.2f} ", color=_PAPER, ha="right", va="center")
    panel.text(1.015, -0.8, "Controller 1 is worse →", va="center")
    caption = (
        "Error of Controller 1 over Controller 2 in six cases. It is the mean error of joint 2, and dashed "
        "is the paper's. Bars have the central 90 % of the plants on which all three controllers are "
        "stable; rings are medians. At the right is on how many Controller 1 errs more. A plant is an arm "
        "with its motion. Dark blue: the runs differ by their controllers alone. Pale blue: something else "
        "differs, or the paper leaves it unsaid. Grey: an equation is changed."
    )
    return style.Drawing("answer", figure, [panel], caption, origin=of_plants(shown))


# Told apart in grey print by lightness: dark, light, lightest, middle.
_LOOKS = {
    "published order: 1, 2, 3": ("#004488", "white"),
    "Controller 1 first, another order": ("#9CC3EA", "black"),
    "neither first nor last": ("#EDEDED", "black"),
    "Controller 1 last": ("#8A8A8A", "black"),
}
_LABELLED = 0.08
"""Shares from here on have their number in the bar."""


@style.journal_style()
def draw_orders(shown: Shown) -> style.Drawing:
    """Draw the shares of the orders, a row for each labelled reading."""
    rows: list[tuple[str, str]] = []
    for title, names in GROUPS.items():
        if labelled := [(label, name) for name, label in names.items() if name in shown.box]:
            rows += [(title, ""), *labelled]
    labels = [label for label, _ in rows]
    readings = [shown.box.get(name) for _, name in rows]
    figure = style.open_figure(style.PAGE_MM, 26.0 + 5.6 * len(rows))
    panel = figure.subplots()
    counts = [f"{reading['plants']:,.0f}" if reading else "" for reading in readings]
    counts[0] = f"stable plants\nof {shown.plants:,}"
    panel.set(xlim=(0.0, 1.0), xticks=np.linspace(0.0, 1.0, 5), ylim=(len(rows) - 0.5, -0.6))
    panel.set_xlabel("share of the plants on which all three controllers are stable")
    panel.xaxis.set_major_formatter(lambda share, _: f"{100.0 * share:.0f} %")
    for axis, side, texts in ((panel, "left", labels), (panel.secondary_yaxis("right"), "right", counts)):
        axis.set_yticks(range(len(rows)), texts)
        axis.tick_params("y", length=0.0)
        axis.spines[side].set_visible(False)
    for tick in panel.get_yticklabels():
        tick.set_fontweight("bold" if tick.get_text() in GROUPS else "normal")
    shares = np.array([order_shares(reading) if reading else [0.0] * 4 for reading in readings]).T
    left = np.zeros(len(rows))
    for (label, (colour, ink)), share in zip(_LOOKS.items(), shares, strict=True):
        bars = panel.barh(range(len(rows)), share, 0.7, left=left, label=label, fc=colour, ec="white", lw=0.5)
        texts = [f"{100.0 * part:.0f} %" if part >= _LABELLED else "" for part in share]
        panel.bar_label(bars, texts, label_type="center", color=ink, fontsize=7)
        left += share
    figure.legend(loc="outside upper center", ncols=2, handlelength=1.4, columnspacing=1.2)
    caption = (
        "How the three controllers rank by their tracking errors, the smallest first. Shares are of the "
        "plants on which all three are stable. Each row is one way to understand the paper, or one change "
        "to it. A place counts where it holds in mean absolute error (MAE) and root mean square error "
        "(RMSE) on both joints."
    )
    return style.Drawing("orders", figure, [panel], caption, origin=of_plants(shown))


def order_shares(reading: Row) -> list[float]:
    """Shares of the four kinds of order; their sum is 1, or 0 without stable plants."""
    if not reading["plants"]:
        return [0.0] * len(_LOOKS)
    published, first, last = (reading[column] for column in ("order", "first", "last"))
    return [published, first - published, 1.0 - first - last, last]


def of_plants(shown: Shown) -> str:
    """What a picture says of its plants."""
    return f"Simulated, {shown.plants:,} plants of the parameter ranges"
