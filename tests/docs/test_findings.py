"""The numbers of README and docs/findings.md, from the stored results and from the shipped configurations."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib.axis import Tick
from matplotlib.text import Text
from support.pages import CONTROLLERS, DOCS, NEEDS_DOCS, cells_of, stored, tables_of, text_of

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.readings import BOTH, SHOWN, default_readings
from tendonrepro.reporting.contents import Row, Shown, read_shown
from tendonrepro.reporting.figures import ANSWER
from tendonrepro.results.figures.style import Drawing, imprint, journal_style
from tendonrepro.verdicts.judge import judge_all
from tendonrepro.verdicts.words import percent

pytestmark = NEEDS_DOCS
README = DOCS.parent / "README.md"


def shown() -> Shown:
    return read_shown(DOCS / "results")


@pytest.fixture(scope="module")
def readings() -> dict[str, Row]:
    return shown().box


@pytest.fixture(scope="module")
def claims() -> dict[str, Any]:
    return {entry["id"]: entry for entry in stored("claims")["claims"]}


@pytest.fixture(scope="module", name="makers")
def _makers() -> Iterator[list[Any]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS)
        yield [importlib.import_module(name) for name in ("pages", "generate", "findings_pictures")]


@pytest.fixture(scope="module", name="pictures")
def _pictures(makers: list[Any]) -> dict[str, Drawing]:
    drawn: dict[str, Drawing] = makers[1].pictures()
    return drawn


def test_made_parts_are_fresh_and_stand_once(makers: list[Any]) -> None:
    """`make pages` and `make findings` write them again."""
    pages, generate, _ = makers
    texts = {path.name: path.read_text(encoding="utf-8") for path in (README, *DOCS.glob("*.md"))}
    for name, text in texts.items():
        assert pages.fresh(text) == text, f"docs/{name} has a part of another day: make pages"
        assert pages.fresh(text, generate.MAKERS) == text, (
            f"docs/{name} has a part of another day: make findings"
        )
    parts = [part["name"] for text in texts.values() for part in pages.PART.finditer(text)]
    assert sorted(parts) == sorted([*pages.MAKERS, *generate.MAKERS])


def test_a_page_has_rows_of_each_long_table_and_the_site_all(makers: list[Any]) -> None:
    pages, generate, _ = makers
    known = {**pages.MAKERS, **generate.MAKERS}
    texts = [path.read_text(encoding="utf-8") for path in DOCS.glob("*.md")]
    long = [part for text in texts for part in pages.PART.finditer(text) if part["kind"] == "site"]
    assert long
    for part in long:
        whole = known[part["name"]]().splitlines()
        assert set(part["shown"].strip().splitlines()) < set(whole)
        assert set(whole) <= set(pages.of_site(part[0], known).splitlines())


def test_readme_has_its_answer_in_sixty_words(readings: dict[str, Row]) -> None:
    """The share of the answer, then its picture, then the first command."""
    text = README.read_text(encoding="utf-8")
    read = re.sub(r"<!--.*?-->|\]\([^)]*\)", "", text)
    assert percent(readings["printed"]["behind"]) in " ".join(read.split()[:60])
    assert text.index("answer.png") < text.index("make figures")


def test_claims_as_a_table_are_those_that_are_stored(makers: list[Any]) -> None:
    assert (DOCS / "results" / "claims.csv").read_text(encoding="utf-8") == makers[1].claims_csv()


def test_pictures_are_described_by_their_captions(makers: list[Any], pictures: dict[str, Drawing]) -> None:
    texts = [text_of(f"docs/{path.name}") for path in DOCS.glob("*.md")] + [text_of("README.md")]
    assert [makers[1].described(text, pictures) for text in texts] == texts
    assert all((DOCS / f"{name}.png").exists() for name in pictures)


def test_no_text_of_a_picture_leaves_it(pictures: dict[str, Drawing]) -> None:
    with journal_style():
        for name, drawing in pictures.items():
            imprint(drawing.figure, drawing.origin)
            drawing.figure.draw_without_rendering()
            ticks = {id(text) for tick in drawing.figure.findobj(Tick) for text in tick.findobj(Text)}
            texts = [
                text for text in drawing.figure.findobj(Text) if text.get_text() and id(text) not in ticks
            ]
            boxes = {id(text): text.get_window_extent() for text in texts}
            page = drawing.figure.bbox.padded(0.5)
            outside = [text.get_text() for text in texts if not _within(boxes[id(text)], page)]
            assert outside == [], name


def _within(inner: Any, outer: Any) -> bool:
    return bool((inner.min >= outer.min).all() and (inner.max <= outer.max).all())


def test_the_motions_that_were_asked_are_named() -> None:
    amplitude = load_ensemble(None).config.box.amplitude
    assert (float(amplitude.low), float(amplitude.high)) == (10.0, 45.0)
    for page in (DOCS.parent / "README.md", DOCS / "findings.md"):
        assert "smooth motions of 10° to 45°" in page.read_text(encoding="utf-8")


def test_words_of_the_tuning() -> None:
    """What tune.md says without a number: no α-TDE beats TDE, nor the reverse, nor PID."""
    found = stored("tune")
    asked = {(row["law"], row["over"]): row for row in found["questions"]}
    alpha = [row for (law, over), row in asked.items() if law.startswith("α-TDE") and over == "TDE and NTSM"]
    pid = [asked[law, "PID"] for law in ("TDE and NTSM", "α-TDE and NTSM, free α")]
    assert len(alpha) == 3
    assert not any(row["smaller_error"] or row["larger_error"] for row in (*alpha, *pid))
    handed, alone = ([row for row in found["alpha"] if row["alone"] is way] for way in (False, True))
    assert {row["alpha_median"] for row in handed} == {row["share_zero"] for row in alone} == {0.0}


def test_no_single_edit_gives_the_published_order() -> None:
    """What findings and slips say of edits without a number."""
    edits = stored("edits")["edits"]
    assert edits[0]["edit"] == "no edit"
    assert len({row["edit"] for row in edits}) == len(edits) > 300
    assert not [row["edit"] for row in edits if row["ranked"] and row["order_share"] > 0.5]
    medians = [[ratio["median"] for ratio in row["ratios"]] for row in edits if row["ranked"]]
    assert not [row for row in medians if (row[0] < 1.0 and row[2] < 1.0) or (row[1] < 1.0 and row[3] < 1.0)]
    (sign,) = (row for row in edits if row["edit"] == "everywhere: α with the other sign")
    (degrees,) = (row for row in edits if row["edit"] == "everywhere: Δ in degrees")
    assert sign["ratios"][0]["median"] < 1.0 < sign["ratios"][2]["median"]
    assert degrees["ratios"][2]["median"] < 1.0 < degrees["ratios"][0]["median"]


def test_words_for_shares(readings: dict[str, Row]) -> None:
    """What stands in words: a third, nearly all, most, almost none."""
    printed, extrapolating = readings["printed"], readings["weights=extrapolating"]
    assert 0.3 < printed["plants"] / shown().plants < 0.36
    assert printed["first"] < 0.01
    assert extrapolating["first"] > 0.9
    assert extrapolating["smooth"] < 0.01
    assert readings[BOTH]["order"] > 0.8
    for name in ("starts=apart", "reference_acceleration=absent+starts=apart", "run_friction=drawn"):
        assert readings[name]["last"] < 0.5 < readings[name]["behind"]
    stable = {name: printed[f"stable_{name}"] for name in CONTROLLERS}
    assert stable.pop("controller_1") > max(stable.values())


def test_medians_are_those_of_the_theory_where_the_load_changes_slowly(readings: dict[str, Row]) -> None:
    """1 + alpha, and 1 - alpha where the weights extrapolate; beta over eta gamma_1, see docs/theory.md."""
    for name in ("encoder=ideal", "feedback=motor", "delay_time=two_periods", "output_delay=2"):
        for joint, alpha in ((2, 0.1), (3, 0.2)):
            assert readings[name][f"c1_c2_joint_{joint}_median"] == pytest.approx(1.0 + alpha, rel=0.02)
    for joint, alpha in ((2, 0.1), (3, 0.2)):
        ideal = readings["encoder=ideal"]
        assert ideal[f"c1_c2_joint_{joint}_q05"] > 1.0
        weights = readings["weights=extrapolating"][f"c1_c2_joint_{joint}_median"]
        assert weights == pytest.approx(1.0 - alpha, rel=0.02)
    assert readings["printed"]["c2_c3_joint_2_median"] == pytest.approx(1.032, rel=0.005)


def test_what_is_shown_is_drawn_by_default() -> None:
    """By the very names that the next ensemble gives its readings."""
    assert SHOWN.keys() <= {reading.name for reading in default_readings(load_ensemble(None).config.pairs)}


def test_picture_of_the_answer(readings: dict[str, Row], pictures: dict[str, Drawing]) -> None:
    """Bars, medians and counts of its rows, and the paper's ratio across."""
    (panel,) = pictures["answer"].axes
    rows = [readings[name] for name in ANSWER]
    bars = [
        [*line.get_xdata()] for line in panel.lines if [*line.get_ydata()] in [[row] * 2 for row in range(6)]
    ]
    assert bars == [[row["c1_c2_joint_2_q05"], row["c1_c2_joint_2_q95"]] for row in rows]
    medians = [line.get_xydata().tolist() for line in panel.lines if line.get_marker() == "o"]
    assert medians == [[[row["c1_c2_joint_2_median"], place]] for place, row in enumerate(rows)]
    (right,) = panel.child_axes
    counts = [label.get_text() for label in right.get_yticklabels()][1:]
    assert counts == [f"{percent(row['behind'])} of {row['plants']:,.0f}" for row in rows]
    (dashed,) = [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == "--"]
    assert dashed == pytest.approx(0.261 / 0.289)


def test_picture_of_the_orders(readings: dict[str, Row], pictures: dict[str, Drawing]) -> None:
    """A bar for each kind of order of each reading that has a label; those of a reading fill its row."""
    labelled = [readings[name] for name in SHOWN if name in readings]
    widths = [[bar.get_width() for bar in bars] for bars in pictures["orders"].axes[0].containers]
    rows = [row for row in zip(*widths, strict=True) if sum(row)]
    assert len(rows) == len(labelled)
    for (in_order, first, _, last), reading in zip(rows, labelled, strict=True):
        assert in_order == reading["order"]
        assert in_order + first == pytest.approx(reading["first"])
        assert last == reading["last"]
    assert [sum(row) for row in rows] == pytest.approx([1.0] * len(labelled))


def test_picture_of_the_map(readings: dict[str, Row], pictures: dict[str, Drawing]) -> None:
    """A dot for each reading under which plants are stable, Table 2, and the arm closest to it."""
    for panel, joint in zip(pictures["map"].axes, (2, 3), strict=True):
        places = [
            [held[f"{pair}_joint_{joint}_median"] for pair in ("c1_c2", "c2_c3")]
            for held in readings.values()
        ]
        dots = next(line for line in panel.lines if line.get_marker() == "o")
        assert dots.get_xydata().tolist() == [place for place in places if not np.isnan(place).any()]
        stars, diamonds = (
            np.array([line.get_xydata()[0] for line in panel.lines if line.get_marker() == marker])
            for marker in "*D"
        )
        if joint == 2:
            assert stars == pytest.approx(
                np.array([[0.261 / 0.289, 0.289 / 0.305], [0.311 / 0.375, 0.375 / 0.436]])
            )
        rows = [row for row in stored("closest") if row["joint"] == joint]
        errors = np.array([[row[f"{metric}_deg"] for row in rows] for metric in ("mae", "rmse")])
        assert diamonds == pytest.approx(errors[:, :2] / errors[:, 1:])


def test_errors_of_the_closest_arm_are_of_joints() -> None:
    config = load_config("closest", "compare").config
    assert isinstance(config, CompareConfig)
    assert config.control.readings.feedback == "joint"


@pytest.mark.slow
def test_the_starts_make_the_order_of_the_closest_arm() -> None:
    rows = {"closest arm": [], "… without its first two seconds": ["errors_from=2"]}
    for row, overrides in rows.items():
        ours = errors_of("closest", *overrides)
        assert cells_of("docs/findings.md", row) == [f"{mae[0]:.3f} / {mae[1]:.3f}" for mae in ours]
        if not overrides:
            in_map = np.array([row["mae_deg"] for row in stored("closest")]).reshape(-1, 2)
            assert in_map == pytest.approx(np.array(ours), rel=1e-3)
        of_joint_2 = [mae[0] for mae in ours]
        assert of_joint_2 == sorted(of_joint_2, reverse=bool(overrides))


def errors_of(experiment: Any, *overrides: str) -> list[list[float]]:
    """MAE of Controllers 1 to 3 on joints 2 and 3, degrees; all of them have to be stable."""
    found = tables_of(experiment, *overrides)
    assert {found["status"][name] for name in CONTROLLERS} == {"ok"}
    return [found["table2"][name]["mae_deg"] for name in CONTROLLERS]


def test_stored_verdicts_follow_from_the_rules_of_today(claims: dict[str, Any]) -> None:
    """What needs nothing but the print is judged again."""
    for verdict in judge_all():
        if verdict.verdict != "not_testable":
            assert claims[verdict.id]["verdict"] == verdict.verdict, verdict.id
