"""The page: its structure, that its numbers are those of the results, that it asks nobody for anything."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from report.conftest import HOSTILE
from support.html_page import Element

from tendonrepro.claims.report import details_text, reader_rows
from tendonrepro.report.sources import Found
from tendonrepro.results.figures.catalogue import FIGURES
from tendonrepro.results.paper_tables import paper_controller_rows

PARTS = ["answer", "claims", "figures", "readings", "assumed", "slips", "again", "rules"]


def test_the_parts_stand_in_order(made: Element) -> None:
    main = made.one("main")
    assert [part.attributes["id"] for part in main.children] == PARTS
    plates = [int(plate.attributes["id"].removeprefix("plate-")) for plate in main.all("article")]
    assert plates == list(FIGURES) == [6, 9, 10, 11, 12, 13, 14, 15, 16]
    headings = [heading.text for heading in main.all("h3")]
    tables = [heading for heading in headings if heading.startswith("Table")]
    assert tables == ["Table 1", "Table 2", "Table 3"]


def test_every_id_is_there_once_and_every_link_lands(made: Element) -> None:
    ids = [element.attributes["id"] for element in made.all() if "id" in element.attributes]
    assert len(ids) == len({*ids})
    targets = [link.attributes["href"] for link in made.all("a")]
    assert {target[1:] for target in targets if target.startswith("#")} <= {*ids}
    assert {target for target in targets if not target.startswith("#")} == {
        "https://doi.org/10.3390/act15050271"
    }


def test_nothing_is_asked_of_anyone(made: Element, text: str) -> None:
    policy = made.one("meta", **{"http-equiv": "Content-Security-Policy"}).attributes["content"]
    assert policy.startswith("default-src 'none'")
    for element in made.all():
        for name in ("src", "srcset", "data", "poster", "xlink:href"):
            assert element.attributes.get(name, "data:").startswith("data:"), element.tag
        assert element.tag not in {"iframe", "object", "embed", "base", "form"}
    assert [link.attributes["href"] for link in made.all("link")] == ["data:,"]
    styles = "".join(style.text for style in made.all("style"))
    assert "url(" not in styles
    assert "@import" not in styles
    assert len(text.encode()) < 5e6


def test_hostile_text_stands_as_text(made: Element) -> None:
    scripts = made.all("script")
    assert sum(script.attributes.get("type") == "application/json" for script in scripts) == len(scripts) - 2
    assert not [name for element in made.all() for name in element.attributes if name.startswith("on")]
    assert [image.attributes["src"][:26] for image in made.all("img")] == ["data:image/svg+xml;base64,"]
    plain = " ".join(HOSTILE.split())
    assert made.one(id="claim-C4").all("td")[0].text == plain
    assert plain in made.one(id="again").text
    assert HOSTILE.replace("'", "") in made.one(id="assumed").text
    assert HOSTILE in [cell.text for cell in made.one(id="assumed").all("td")]


def test_the_ledger_is_that_of_the_claims(made: Element, found: Found) -> None:
    places = {element.attributes.get("id"): element for element in made.one(id="claims").all()}
    for one, cells in zip(found.verdicts, reader_rows(found.verdicts), strict=True):
        row = places[f"claim-{one.id}"].text.replace("\u00a0", " ")
        for shown in (cells["Ours"], one.verdict.replace("_", " "), one.rule.replace("_", " ")):
            assert shown in row, one.id
        if "." in one.id:
            for name in ("Printed", "Central 90 %", "Also passing"):
                assert cells[name] in row, one.id
        assert (" †" in row) == one.shipped
        assert places[f"evidence-{one.id}"].text == " ".join(details_text(one).split())
    assert "taken from the ensemble that comes with the package" in made.one(id="claims").text


def test_the_overview_counts_each_verdict_once(made: Element, found: Found) -> None:
    groups = made.all("section", class_="group")
    claims = [one.id for one in found.verdicts if "." not in one.id and one.repeats is None]
    linked = [link.text for group in groups for link in group.all("a") if "claim-" in link.attributes["href"]]
    assert sorted(linked) == sorted(claims)
    numbers = [int(link.text) for group in groups for link in group.all("a", href="#numbers")]
    assert sum(numbers) == sum("." in one.id and one.repeats is None for one in found.verdicts)


def test_tables_are_those_of_the_runs(made: Element, found: Found) -> None:
    assert found.compare is not None
    rows = [
        [str(row[key]) for key in ("paper_row", "mae_pair", "rmse_pair")]
        for row in paper_controller_rows(found.compare)
    ]
    cells = made.one("table", id="table2_paper").cells()[1:]
    assert [[row[0], row[1], row[-3] if len(row) == 6 else row[2]] for row in cells] == rows


def test_the_words_are_those_of_the_findings(made: Element, found: Found) -> None:
    said = [
        item.text.replace("\u00a0", " ")
        for item in made.one(id="answer").all("li")
        if not item.all("a", href="#numbers")
    ]
    for line in found.said:
        plain = re.sub(r"\*\*|`|\[([^]]*[a-z][^]]*)\]\([^)]*\)", lambda mark: mark[1] or "", line)
        assert plain in said
    assert len(made.one(id="answer").all("ol", class_="findings")[0].children) == 3


@pytest.mark.parametrize(
    ("number", "panel", "name", "variable", "joint"),
    [
        (14, 0, "Controller 1", "q_encoder", 0),
        (14, 1, "Desired", "q_d", 1),
        (16, 0, "Controller 1, no payload", "q_encoder", 0),
    ],
)
def test_curves_hold_samples_of_the_trace(
    made: Element, found: Found, number: int, panel: int, name: str, variable: str, joint: int
) -> None:
    figure = made.one("figure", id=f"figure-{number}")
    panels = json.loads(figure.one("script").text)
    (curve,) = [curve for curve in panels[panel]["curves"] if curve["name"] == name]
    assert found.compare is not None
    trace = found.compare.runs["controller_1"]
    values = np.rad2deg(trace[variable][:, joint])
    places = np.rint(np.array(curve["x"]) / 0.01).astype(int)
    np.testing.assert_allclose(curve["x"], trace.time[places], atol=1e-9)
    # A panel's range is some 35 deg, of which four more digits are kept.
    np.testing.assert_allclose(curve["y"], values[places], atol=5e-4)
    assert {values.min().round(3), values.max().round(3)} <= {round(y, 3) for y in curve["y"]}
    assert len(curve["x"]) <= 1202
    paths = [path.attributes for path in figure.all("path") if path.attributes.get("data-name") == name]
    assert len(paths) >= 2
    assert all(re.fullmatch(r"M-?[\d.]+ -?[\d.]+(L-?[\d.]+ -?[\d.]+)*", path["d"]) for path in paths)


def test_every_figure_is_drawn_and_named(made: Element) -> None:
    for number in FIGURES:
        drawings = made.one("article", id=f"plate-{number}").all("svg", class_="static")
        assert drawings, number
        for drawing in drawings:
            assert drawing.attributes["role"] == "img"
            assert drawing.attributes["aria-label"].startswith(f"Figure {number} ")
            assert drawing.all("path", class_="curve")


def test_what_was_not_run_shows_its_command(made: Element) -> None:
    absent = " ".join(element.text for element in made.all("p", class_="absent"))
    for command in ("tendonrepro ensemble", "tendonrepro fetch"):
        assert command in absent
    assert "tendonrepro statics" not in absent
    assert "50 %" in made.one(id="assumed").text.replace("\u00a0", " ")


def test_inputs_stand_with_their_digests(made: Element, found: Found, results: Path) -> None:
    from tendonrepro.files import sha256_of

    shown = dict(made.one(id="again").all("table")[-1].cells()[1:])
    assert shown == found.inputs
    assert shown["compare/traces.h5"] == sha256_of(results / "compare" / "traces.h5")
    assert {"statics/statics.json", "shipped docs/results/claims.json"} <= shown.keys()


@pytest.mark.slow
def test_equal_inputs_give_equal_bytes(found: Found, text: str) -> None:
    from tendonrepro.report.page import page

    assert page(found) == text
