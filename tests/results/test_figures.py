"""The figures, by their artists: panels, curves, labels, ranges, and what is said when something is amiss."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from support.measured_synthetic import with_runs
from support.synthetic import S, make_compare_file, make_decouple_file, whole

from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.experiments.run import experiment_result
from tendonrepro.results.figures import FORMATS
from tendonrepro.results.figures.catalogue import FIGURES, draw, drawings
from tendonrepro.results.figures.style import SERIES, Drawing, journal_style, save_drawing, thin
from tendonrepro.results.paper import with_what_they_are
from tendonrepro.results.records import Trace, TraceFile

compare_file = cache(make_compare_file)
decouple_file = cache(make_decouple_file)

THREE = ["Controller 1", "Controller 2", "Controller 3"]
UNITS = {
    "fig09": ["deg"],
    "fig06": ["", "", "deg", "deg"],
    **dict.fromkeys(("fig10", "fig11", "fig12", "fig13"), ["deg"] * 2),
    **dict.fromkeys(("fig14", "fig16"), ["deg"] * 6),
    "fig15": ["rad/s", "rad/s", "N m", "N m", "N m", "N m"],
    "samples": ["rad/s", "rad/s", "N m", "N m"],
}
NAMES = [name for name in FIGURES if not name.startswith("joint_")]
"""Those of the paper's arm; the others are as its Figures 10 to 12."""
every_figure = pytest.mark.parametrize("name", NAMES)


def source(name: str) -> TraceFile:
    return decouple_file() if name in drawings(decouple_file()) else compare_file()


@cache
def drawn(name: str) -> Drawing:
    artists = draw(name, source(name))
    # Legends and labels find their places when drawn, and the density of ticks follows the style in force.
    with journal_style():
        artists.figure.draw_without_rendering()
    return artists


def legend_texts(artists: Drawing) -> list[str]:
    return [text.get_text() for legend in artists.figure.legends for text in legend.get_texts()]


def values(line: Line2D) -> np.ndarray:
    return np.asarray(line.get_ydata())


def with_status(trace: Trace, status: str, **changed: np.ndarray) -> Trace:
    attributes = {**trace.attributes, "status": status}
    return replace(trace, variables={**trace.variables, **changed}, attributes=attributes)


# --- what is in a figure -----------------------------------------------------------------------------------


def test_each_experiment_gives_its_figures() -> None:
    assert sorted([*drawings(decouple_file()), *drawings(compare_file())]) == sorted(NAMES)
    assert UNITS.keys() == set(NAMES)


def test_each_joint_of_an_arm_of_four_is_drawn() -> None:
    file = decouple_file()
    trace = file.runs["decouple"]
    variables = {name: np.column_stack([2.0 * x[:, 0], x]) for name, x in trace.variables.items()}
    four = replace(file, runs={"decouple": replace(trace, joint=(1, 2, 3, 4), variables=variables)})
    assert [name for name in drawings(four) if FIGURES[name].joints] == [
        "fig10",
        "fig11",
        "fig12",
        "joint_4",
    ]
    calculated = draw("joint_4", four).lines["a", "Calculated"]
    angle = np.rad2deg(trace["q_calculated"][:, -1])
    assert (values(calculated).min(), values(calculated).max()) == pytest.approx((angle.min(), angle.max()))


@pytest.mark.parametrize("name", UNITS)
def test_panels_say_their_units_and_have_the_size_of_a_column_or_page(name: str) -> None:
    artists = drawn(name)
    assert [panel.get_ylabel().rpartition("(")[2] for panel in artists.axes.values()] == [
        unit and f"{unit})" for unit in UNITS[name]
    ]
    assert artists.figure.get_figwidth() * 25.4 == pytest.approx(85.0 if "fig06" < name < "fig14" else 175.0)
    end = 9.0 if name == "fig06" else 36.0 if name < "fig13" else 18.0
    if name != "samples":
        assert [*artists.axes.values()][-1].get_xlim() == pytest.approx((0.0, end))


# --- what a journal would check ----------------------------------------------------------------------------


def shown_texts(artists: Drawing) -> list[Text]:
    texts = [text for legend in artists.figure.legends for text in legend.get_texts()]
    texts += artists.figure.texts
    for panel in artists.axes.values():
        titles = [title for title in panel.findobj(Text) if title.get_text()]
        ticks = {label for axis in (panel.xaxis, panel.yaxis) for label in axis.get_ticklabels(which="both")}
        texts += [text for text in titles if text not in ticks and text.get_visible()]
        for axis in (panel.xaxis, panel.yaxis) if panel.axison else ():
            low, high = sorted(axis.get_view_interval())
            places = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
            texts += [label for place, label in places if low <= place <= high and label.get_visible()]
    return texts


def apart(first: Bbox, second: Bbox) -> bool:
    return Bbox.intersection(first, second) is None


def assert_texts_are_apart(artists: Drawing) -> None:
    with journal_style():
        artists.figure.draw_without_rendering()
        texts = shown_texts(artists)
    page = artists.figure.bbox
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    outside = [text for text, box in boxes if Bbox.union([box, page]).bounds != page.bounds]
    assert outside == []
    touching = [(a[0], b[0]) for a, b in combinations(boxes, 2) if not apart(a[1], b[1])]
    assert touching == []
    legends = [legend.get_window_extent() for legend in artists.figure.legends]
    assert all(apart(box, panel.bbox) for box in legends for panel in artists.axes.values())


def fitted(file: TraceFile) -> TraceFile:
    """The same with a plant that was fitted to the print, under two readings."""
    under = {"weights": "extrapolating", "phi_branch": "power", "start": "filled"}
    runs = {
        name: replace(trace, attributes=trace.attributes | {"readings": under})
        for name, trace in file.runs.items()
    }
    if second := runs.get("controller_2"):
        runs["controller_2"] = replace(second, attributes=second.attributes | {"start_offset": [0.0, 0.01]})
    source = "mass: {value: 1, source: 'identified: Tables 2 and 3, misfit 0.04'}"
    return with_what_they_are(replace(file, config_yaml=source, runs=runs))


def with_a_long_origin(file: TraceFile) -> TraceFile:
    """The same by a configuration with a long name and changes, as long as a picture names each."""
    config = {"origin": "/home/me/an_arm_of_my_own_with_many_joints_and_a_very_long_name.yaml"}
    changes = [f"control.gains.alpha={'0' * 37}"]
    return replace(fitted(file), manifest={"config": config, "overrides": changes})


@pytest.mark.parametrize("long", [False, True])
@every_figure
def test_no_text_touches_another_or_leaves_the_page(name: str, long: bool) -> None:
    artists = draw(name, with_a_long_origin(source(name))) if long else drawn(name)
    origin = artists.figure.get_supxlabel().split()
    assert "".join(origin) == artists.origin.replace(" ", "")
    assert "phi_branch=power+weights=extrapolating" in artists.origin or not long
    assert_texts_are_apart(artists)


def with_six_joints(file: TraceFile) -> TraceFile:
    """The same of an arm of a user's own, each of whose joints is like one of two."""

    def six(trace: Trace) -> Trace:
        variables = {name: np.column_stack([value] * 3) for name, value in trace.variables.items()}
        gains = {name: [*value] * 3 for name, value in trace.attributes["gains"].items()}
        attributes = {**trace.attributes, "gains": gains}
        return replace(trace, joint=(1, 2, 3, 4, 5, 6), variables=variables, attributes=attributes)

    runs = {name: six(trace) for name, trace in file.runs.items()}
    return replace(file, runs=runs, plant=replace(file.plant, attributes={"arm": "SYNTHETIC"}))


@pytest.mark.parametrize("name", ["fig14", "fig15", "fig16", "samples"])
def test_six_joints_have_room_side_by_side(name: str) -> None:
    artists = draw(name, with_six_joints(compare_file()))
    assert_texts_are_apart(artists)
    labelled = [bool(panel.get_ylabel()) for panel in artists.axes.values()]
    assert labelled == [True, *[False] * 5] * (len(labelled) // 6)


# --- the curves are the traces -----------------------------------------------------------------------------


@pytest.mark.parametrize(("letter", "variable", "column"), [("a", "q_encoder", 0), ("d", "e", 1)])
def test_tracking_curves_hold_the_trace_to_its_extremes(letter: str, variable: str, column: int) -> None:
    for name in THREE:
        trace = compare_file().runs[name.lower().replace(" ", "_")]
        expected = np.rad2deg(trace[variable][:, column])
        found = values(drawn("fig14").lines[letter, name])
        assert (found.min(), found.max()) == (expected.min(), expected.max())
        assert (found[0], found[-1]) == (expected[0], expected[-1])
        assert np.isin(found, expected).all()


@every_figure
def test_every_curve_and_band_is_inside_its_panel(name: str) -> None:
    artists = drawn(name)
    heights = [(key, values(line)) for key, line in artists.lines.items()]
    heights += [(key, band.get_xy()[:, 1]) for key, band in artists.bands.items()]
    for (letter, curve), height in heights:
        low, high = artists.axes[letter].get_ylim()
        assert low < height.min() <= height.max() < high, curve


@pytest.mark.parametrize(
    ("figure", "name", "key"),
    [
        ("fig14", "controller_3", "Controller 3 less that of Controller 2"),
        ("fig16", "controller_1_payload", "Controller 1, 0.2 kg payload less that without payload"),
    ],
)
def test_the_lowest_panels_have_the_sizes_of_errors_less_those_of_one_run(
    figure: str, name: str, key: str
) -> None:
    """As 50 ms means, in the strokes of the panels above, and marked as ours."""
    artists, run = drawn(figure), compare_file().runs[name]
    base = compare_file().runs["controller_2" if figure == "fig14" else "controller_1"]
    for column, letter in enumerate("ef"):
        line, above = artists.lines[letter, key], artists.lines["cd"[column], key.partition(" less")[0]]
        expected = np.abs(np.rad2deg(run["e"][:, column])) - np.abs(np.rad2deg(base["e"][:, column]))
        times = np.asarray(line.get_xdata())
        assert (times[0], times[-1]) == (run.time[0], run.time[-1])
        for k in range(1, len(times) - 1, 7):
            near = np.abs(run.time - times[k]) < 0.0251
            assert values(line)[k] == pytest.approx(expected[near].mean(), abs=1e-12)
        assert (line.get_color(), line.get_linestyle()) == (above.get_color(), above.get_linestyle())
        assert artists.axes[letter].get_title(loc="right")
    assert len([key for key in artists.lines if key[0] == "e"]) == (2 if figure == "fig14" else 1)


def test_errors_are_compared_with_another_run_where_controller_2_is_not_there_to_the_end() -> None:
    artists = draw(14, make_compare_file(diverged={"controller_2": 4.23}))
    names = [f"Controller {number} less that of Controller 1" for number in (2, 3)]
    assert {name for letter, name in artists.lines if letter == "f"} == {*names}
    assert np.asarray(artists.lines["f", names[0]].get_xdata())[-1] == pytest.approx(4.23)
    assert np.abs(artists.axes["f"].get_ylim()).max() < 1.0


@pytest.mark.parametrize(
    "held",
    [
        {"runs": ("controller_1",)},
        {"diverged": {"controller_1": 4.0, "controller_2": 5.0, "controller_3": 6.0}},
        {"without": ("e",)},
        {"source": "measured"},
    ],
    ids=["one run", "all diverged", "no errors", "logs of other times"],
)
def test_there_is_no_panel_of_differences_where_there_are_none(held: dict[str, Any]) -> None:
    assert [*draw(14, make_compare_file(step=0.05, **held)).axes] == [*"abcd"]


def test_motor_angles_come_from_the_coupling_matrix() -> None:
    trace = compare_file().runs["controller_1"]
    # At equal angles q of joints 2 and 3: motor 2 turns 77/37 q, motor 3 turns q - 35/37 q.
    desired = np.rad2deg(trace["q_d"][:, 0]).max()
    lines = drawn("fig13").lines
    assert values(lines["a", "Motor 2 desired"]).max() == pytest.approx(desired * 77 / 37)
    assert values(lines["a", "Motor 3 desired"]).max() == pytest.approx(desired * 2 / 37)
    e = np.rad2deg(trace["e"])
    expected = (e[:, 1] - 35 / 37 * e[:, 0]).min()
    assert -values(lines["b", "Motor 3"]).max() == pytest.approx(expected)


def test_difference_of_a_joint_and_its_mean() -> None:
    joint = 2
    trace = decouple_file().runs["decouple"]
    expected = np.rad2deg(trace["q_calculated"] - trace["q_encoder"])[:, joint - 1]
    artists = drawn(f"fig{9 + joint}")
    found = values(artists.lines["b", "Difference"])
    assert (found.min(), found.max()) == pytest.approx((expected.min(), expected.max()))
    steps, size = artists.axes["b"].get_title(loc="right").split("\n")
    assert re.findall(r"[\d.]+", steps) == ["0.022"]
    assert re.findall(r"[\d.]+", size) == [f"{np.abs(expected).mean():.4f}"]
    ideal = replace(trace, variables=trace.variables | {"q_encoder": trace["q"]})
    without_steps = draw(9 + joint, with_runs(decouple_file(), decouple=ideal))
    assert "\n" not in without_steps.axes["b"].get_title(loc="right")


def test_equal_motions_have_equal_axes() -> None:
    limits = {drawn(f"fig{number}").axes["a"].get_ylim() for number in (10, 11, 12)}
    assert len(limits) == 1
    limits = {drawn(name).axes[letter].get_ylim() for name in ("fig14", "fig16") for letter in "ab"}
    assert len(limits) == 1


def test_errors_of_all_joints_are_drawn_in_one_way_and_the_legend_has_their_bands() -> None:
    assert not drawn("fig14").bands, "errors well above the encoder's steps are drawn as they are"
    trace = compare_file().runs["controller_2"]
    noise = np.deg2rad(0.3) * np.random.default_rng(0).standard_normal(len(trace.time))
    fuzzy = trace["e"] + np.column_stack([np.zeros_like(noise), noise])
    artists = draw(14, with_runs(compare_file(), controller_2=with_status(trace, "ok", e=fuzzy)))
    assert artists.bands.keys() == {(letter, name) for letter in "cd" for name in THREE}
    assert len(legend_texts(artists)) == 5
    assert len({artists.axes[letter].get_title() for letter in "ac"}) == 1


def test_bands_are_opaque_the_narrowest_on_top_and_in_the_legend() -> None:
    artists = drawn("fig15")
    bands = {name: artists.bands["d", name] for name in THREE}
    colours = [to_rgba(band.get_facecolor()) for band in bands.values()]
    (shared,) = (band.get_facecolor()[0] for band in artists.axes["d"].collections)
    assert len({*colours, tuple(shared)}) == 4
    assert all(colour[3] == 1.0 for colour in colours)
    (legend,) = artists.figure.legends
    assert {*colours} <= {patch.get_facecolor() for patch in legend.findobj(Rectangle)}
    widest_first = sorted(bands.values(), key=lambda band: band.get_zorder())
    edges = [np.split(band.get_xy()[:-1, 1], 2) for band in widest_first]
    widths = [float(np.mean(up - down[::-1])) for up, down in edges]
    assert widths == sorted(widths, reverse=True)


@pytest.mark.parametrize("number", [9, 14])
def test_every_picture_says_that_it_is_simulated_and_by_which_configuration(number: int) -> None:
    manifest = {"config": {"origin": "/home/me/mine.yaml"}, "overrides": ["a.b=1"]}
    file = replace(source(f"fig{number:02d}"), manifest=manifest)
    said = draw(number, file).figure.get_supxlabel()
    assert said == "Simulated, configuration mine.yaml, a.b=1 (00000000)"
    many = replace(file, manifest=manifest | {"overrides": ["a.long.key=1"] * 9})
    assert draw(number, many).origin.endswith("mine.yaml, 9 settings changed (00000000)")
    assert draw(number, replace(file, source="measured")).figure.get_supxlabel() == "Measured"


def test_of_a_fitted_plant_the_terminal_says_under_which_reading() -> None:
    assert "phi_branch=power+weights=extrapolating+starts=apart" in str(
        experiment_result(fitted(compare_file()))
    )
    assert "phi_branch" not in str(experiment_result(compare_file()))


def test_pulling_tendon_1_states_the_slope_of_joint_2() -> None:
    note = drawn("fig06").axes["d"].get_title(loc="right")
    slope, coupling = map(float, re.findall(r"= (\d\.\d+)", note))
    assert coupling == pytest.approx(35 / 77, abs=5e-5)
    assert coupling == pytest.approx(S[1, 0] / S[0, 0], abs=5e-5)
    assert slope == pytest.approx(coupling, abs=1e-3)
    assert np.ptp(values(drawn("fig06").lines["c", "Motor 2"])) == 0.0
    assert np.ptp(values(drawn("fig06").lines["d", "Joint 2"])) > 10.0
    trace = decouple_file().runs["pull_tendon_1"]
    still = replace(trace, variables={name: np.zeros_like(value) for name, value in trace.variables.items()})
    resting = draw(6, with_runs(decouple_file(), pull_tendon_1=still))
    assert resting.axes["d"].get_title(loc="right") == "", "no slope when nothing moved"


def test_figure_6_draws_the_arm_before_and_after_and_where_the_text_sees_link_2() -> None:
    """Joint 2 turns with joint 1; in section 3.1 it turns back, so that link 2 keeps its direction."""
    plant, trace = decouple_file().plant, decouple_file().runs["pull_tendon_1"]
    length, start = (plant.values[key].value for key in ("length", "posture"))
    far = trace["q_encoder"][np.abs(trace["q_motor_encoder"][:, 0]).argmax()]

    def chain(q: np.ndarray) -> np.ndarray:
        angle = np.cumsum(start + q)
        links = -length[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
        return np.vstack([np.zeros(2), np.cumsum(links, axis=0)])

    panels = drawn("fig06").axes
    before, after = (
        [line.get_xydata() for line in panels[letter].lines if line.get_linewidth() == 7.0] for letter in "ab"
    )
    assert before[-1] == pytest.approx(chain(np.zeros(3)))
    assert after[-1] == pytest.approx(chain(far))
    (dashed,) = (line for line in panels["b"].lines if line.is_dashed())
    there = np.asarray(dashed.get_xydata())
    assert there[0] == pytest.approx(chain(far)[1])
    assert np.diff(there, axis=0)[0] == pytest.approx(chain(np.zeros(3))[2] - chain(np.zeros(3))[1])
    other = replace(plant, attributes={"arm": "SYNTHETIC"})
    others = draw(6, replace(decouple_file(), plant=other))
    assert not [line for line in others.axes["b"].lines if line.is_dashed()]
    of_paper = FIGURES["fig06"].of_paper
    assert (of_paper in drawn("fig06").caption, of_paper in others.caption) == (True, False)
    routed = draw(6, whole(decouple_file())).axes["a"]
    assert len(routed.lines) == len(panels["a"].lines) + 3, "the tendons of three motors"


@pytest.mark.parametrize(("letter", "variable", "column"), [("b", "s", 1), ("e", "tau_m", 0)])
def test_curves_are_50_ms_means_and_bands_the_rms_of_the_samples_about_them(
    letter: str, variable: str, column: int
) -> None:
    trace = compare_file().runs["controller_2"]
    raw = trace[variable][:, column]
    line = drawn("fig15").lines[letter, "Controller 2"]
    times = np.asarray(line.get_xdata())
    for k in range(1, 40):
        near = np.abs(trace.time - times[k]) < 0.0251
        assert values(line)[k] == pytest.approx(raw[near].mean())
    corners = drawn("fig15").bands[letter, "Controller 2"].get_xy()
    about = raw - np.array([raw[np.abs(trace.time - t) < 0.0251].mean() for t in trace.time])
    assert (corners[:, 0].min(), corners[:, 0].max()) == (trace.time[0], trace.time[-1])
    for time in np.unique(corners[:, 0])[3:-3:10]:
        low, high = np.sort(corners[corners[:, 0] == time, 1])[[0, -1]]
        rms = np.sqrt(np.mean(about[np.abs(trace.time - time) < 0.2501] ** 2))
        assert 0.5 * (high - low) == pytest.approx(rms, rel=1e-9, abs=1e-8)
        assert 0.5 * (high + low) == pytest.approx(np.interp(time, times, values(line)))


@pytest.mark.parametrize(("letter", "variable", "column"), [("a", "s", 0), ("d", "tau_m", 1)])
def test_from_near_every_raw_sample_of_20_ms_is_drawn_where_the_motion_is_fastest(
    letter: str, variable: str, column: int
) -> None:
    artists = drawn("samples")
    start, end = artists.axes[letter].get_xlim()
    assert end - start == pytest.approx(0.02)
    marks = [line for line in drawn("fig15").axes["af"[column]].lines if "samples" in str(line.get_label())]
    assert [start < np.asarray(mark.get_xdata())[0] < end for mark in marks] == [True]
    trace = compare_file().runs["controller_1"]
    speed = np.gradient(trace["q_d"][:, column], trace.time)
    assert start < trace.time[np.flatnonzero(speed > 0.999 * speed.max())[0]] < end
    assert end < 9.0, "in the first of two equal periods"
    for name in THREE:
        trace = compare_file().runs[name.lower().replace(" ", "_")]
        inside = (trace.time > start - 1e-6) & (trace.time < end + 1e-6)
        line = artists.lines[letter, name]
        assert values(line).tolist() == trace[variable][inside, column].tolist()
        assert line.get_drawstyle() == "steps-post"


# --- thinning ----------------------------------------------------------------------------------------------


def test_thinning_keeps_every_extreme_of_its_groups_in_order() -> None:
    rng = np.random.default_rng(1)
    time = np.cumsum(0.1 + rng.random(18_001))
    signal = rng.standard_normal(18_001)
    x, y = thin(time, signal)
    assert (np.diff(x) > 0.0).all()
    assert (y == signal[np.searchsorted(time, x)]).all()
    assert (x[0], x[-1]) == (time[0], time[-1])
    assert len(x) <= 1202
    for start in range(0, 18_001, 31):
        group = signal[start : start + 31]
        assert np.isin([group.min(), group.max()], y).all()


# --- runs that went wrong, are missing, or come from elsewhere ---------------------------------------------


def test_diverged_run_is_drawn_to_its_end_and_named_so() -> None:
    artists = draw(14, make_compare_file(diverged={"controller_2": 4.23}))
    assert legend_texts(artists) == ["Desired", THREE[0], "Controller 2 (diverged at 4.23 s)", THREE[2]]
    line, panel = artists.lines["c", "Controller 2"], artists.axes["c"]
    assert np.asarray(line.get_xdata())[-1] == pytest.approx(4.23)
    # The error beyond 10 degrees leaves the panel to the others; its end is marked at the edge.
    low, high = panel.get_ylim()
    assert np.abs(values(line)).max() > 10.0
    assert max(abs(low), abs(high)) < 1.0
    (mark,) = [found for found in panel.lines if found.get_marker() == "x"]
    assert np.asarray(mark.get_xdata()).item() == pytest.approx(4.23)
    assert low <= np.asarray(mark.get_ydata()).item() <= high
    assert "controller_2 (diverged at 4.23 s)" in artists.caption
    assert panel.get_xlim() == pytest.approx((0.0, 18.0))


@pytest.mark.parametrize("name", ["fig13", "samples"])
def test_runs_that_diverge_at_once_leave_room(name: str) -> None:
    ends = {"controller_1": 0.28, "controller_2": 0.36, "controller_3": 0.25}
    assert_texts_are_apart(draw(name, make_compare_file(diverged=ends)))


@pytest.mark.pictures
def test_overflow_at_the_end_of_a_diverged_run_can_be_drawn_and_saved(tmp_path: Path) -> None:
    trace = compare_file().runs["controller_2"]
    changed = {name: trace[name].copy() for name in ("q_encoder", "e", "s", "H_hat", "tau_m")}
    for value in changed.values():
        value[-3:] = np.array([[1e300], [-1e300], [np.nan]])
    artists = draw(15, replace(compare_file(), runs={trace.name: with_status(trace, "diverged", **changed)}))
    assert len(save_drawing(artists, tmp_path, FORMATS)) == 4
    assert np.isfinite(artists.axes["c"].get_ylim()).all()


@pytest.mark.parametrize("number", [13, 14, 15])
def test_a_run_of_a_single_sample_can_be_drawn(number: int) -> None:
    trace = compare_file().runs["controller_1"]
    first = {name: value[:1] for name, value in trace.variables.items()}
    short = with_status(replace(trace, time=trace.time[:1], variables=first), "diverged")
    artists = draw(number, replace(compare_file(), runs={trace.name: short}))
    for panel in artists.axes.values():
        (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
        assert left < right
        assert low < high


def test_a_law_of_the_users_own_joins_the_others_and_ringing_is_said() -> None:
    own = with_status(replace(compare_file().runs["controller_1"], name="own_law"), "ringing")
    artists = draw(15, with_runs(compare_file(), own_law=own))
    assert legend_texts(artists)[:4] == [*THREE, "Own law (ringing)"]
    (line,) = (line for (letter, name), line in artists.lines.items() if letter == "c" and name not in THREE)
    assert line.get_color() == SERIES[3].colour
    assert "own_law (ringing)" in artists.caption


@pytest.mark.parametrize("near", [False, True])
def test_figure_15_has_the_bound_of_section_4_3(near: bool) -> None:
    """max |epsilon| / lambda of Controller 1; the last sample's epsilon is not known.

    A bound far outside a panel stands in the caption alone.
    """
    run = compare_file().runs["controller_1"]
    epsilon = run["epsilon"] * (1e-4 if near else 1.0)
    lam = np.asarray(run.attributes["gains"]["lam"])
    bounds = np.abs(epsilon[:-1]).max(axis=0) / lam
    unknown = np.vstack([epsilon[:-1], [[1e3, 1e3]]])
    artists = draw(15, with_runs(compare_file(), controller_1=with_status(run, "ok", epsilon=unknown)))
    for letter, bound in zip("ab", bounds, strict=True):
        remark = artists.axes[letter].get_title(loc="right")
        said = f"{bound:.2g} rad/s"
        assert (said in remark, said in artists.caption) == (near, not near)
        assert remark or not near


def test_measured_traces_without_the_laws_inside_say_not_recorded() -> None:
    file = make_compare_file(source="measured", without=("s", "H_hat"))
    artists = draw(15, file)
    remarks = {letter: [text.get_text() for text in panel.texts] for letter, panel in artists.axes.items()}
    missing = "abcd"
    assert remarks == {letter: ["not recorded"] * (letter in missing) for letter in "abcdef"}
    assert all(len(artists.axes[letter].get_yticks()) == 0 for letter in missing)
    assert "Measured, run" in artists.caption
    assert legend_texts(draw(10, make_decouple_file(source="measured")))[0] == "Encoder (measured)"
    errors_below = draw(14, make_compare_file(without=("e",))).axes["d"]
    assert [text.get_text() for text in errors_below.texts] == ["not recorded"]
    assert "fig15" not in drawings(make_compare_file(without=("s", "H_hat", "tau_m")))
    assert not {"fig13", "fig14", "fig16"} & drawings(make_compare_file(without=("q_encoder", "e"))).keys()


def test_a_figure_that_does_not_exist_or_of_the_other_experiment_is_refused() -> None:
    for figure in (7, "17", "fig7", "-1"):
        with pytest.raises(UsageError, match=str(figure)):
            draw(figure, compare_file())
    with pytest.raises(DataMissingError, match="Figure 14"):
        draw("14", decouple_file())


# --- files -------------------------------------------------------------------------------------------------


@pytest.mark.pictures
def test_three_pictures_with_numbered_names_and_a_caption_beside_them(tmp_path: Path) -> None:
    paths = save_drawing(drawn("fig09"), tmp_path / "new" / "figures", FORMATS)
    assert [path.name for path in paths] == ["fig09.png", "fig09.pdf", "fig09.svg", "fig09.txt"]
    starts = [path.read_bytes()[:5] for path in paths[:3]]
    assert starts == [b"\x89PNG\r", b"%PDF-", b"<?xml"]
    caption, origin = paths[3].read_text(encoding="utf-8").split("\n\n")
    assert caption == drawn("fig09").caption
    assert caption.startswith("Figure 9. ")
    assert "run decouple, 0 to 36 s" in caption
    assert drawn("fig09").origin in origin
    assert set(paths[0].parent.iterdir()) == set(paths)
    (tmp_path / "blocked").write_text("in the way")
    with pytest.raises(TendonreproError, match="fig09"):
        save_drawing(drawn("fig09"), tmp_path / "blocked")


@pytest.mark.pictures
def test_the_users_own_matplotlib_settings_have_no_say_and_are_left_alone(tmp_path: Path) -> None:
    before = [path.read_bytes() for path in save_drawing(draw(9, decouple_file()), tmp_path)]
    with mpl.rc_context({"axes.grid": True, "font.size": 20.0, "svg.fonttype": "path", "savefig.dpi": 50}):
        after = [path.read_bytes() for path in save_drawing(draw(9, decouple_file()), tmp_path)]
        assert mpl.rcParams["font.size"] == 20.0
    assert before == after
