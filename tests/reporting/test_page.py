"""The page: its structure, that its numbers are those of the results, that it asks nobody for anything."""

import shutil
from dataclasses import replace

import pytest
from PIL import Image
from reporting.conftest import LIKE_HTML
from support.browser import CHROMIUM, DRIVER, Browser
from support.html_page import read_page

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import SHOWN
from tendonrepro.reporting.page import page, pictures, plate, stored_under
from tendonrepro.verdicts import words
from tendonrepro.verdicts.rules import VERDICTS
from tendonrepro.verdicts.words import MAIN, claim_in_words, percent

PARTS = "answer why decouple compare claims inconsistencies questions assumptions again"


def plain(text):
    return text.replace("\u00a0", " ")


@pytest.fixture(scope="module")
def ledger(found):
    return found.ledger.verdicts


def test_the_parts_stand_in_order(made, results):
    main = made.one("main")
    assert " ".join(part.attributes["id"] for part in main.children) == PARTS
    assert [len(made.one(id=name).all("figure")) for name in ("answer", "why")] == [1, 1]
    captions = [figure.one("figcaption").text for figure in main.all("figure")][2:]
    assert captions == [f"About {name}" for name in sorted(path.stem for path in results.glob("*/*/*.svg"))]
    assert "results of 2027-01-02" in made.one("header").text


def test_of_another_arm_the_page_has_its_results_alone(found):
    arm = load_config(None, "compare").tree["manipulator"] | {"name": "Mine"}
    held = {
        name: dict(manifest, config=dict(manifest["config"], tree={"manipulator": arm}))
        for name, manifest in found.manifests.items()
    }
    made = read_page(page(replace(found, manifests=held)))
    parts = [part.attributes["id"] for part in made.one("main").children]
    assert parts == ["decouple", "compare", "assumptions", "again"]
    assert "Mine" in made.one("h1").text


def test_the_ten_claims(made, ledger):
    head, *rows = made.one(id="answer").one("table").cells()
    assert len(head) == 3
    assert len(rows) == len(MAIN) == 10
    for row, name in zip(rows, MAIN, strict=True):
        said = [f"{claim_in_words(name)} {ledger[name].where}", words.ours(ledger[name])]
        assert [plain(cell) for cell in row[:2]] == said
        assert row[2].startswith(VERDICTS[ledger[name].verdict])


def test_every_verdict_stands_once_with_its_evidence(made, ledger):
    entries = [entry for entry in ledger.values() if entry.repeats is None or entry.kind == "ensemble"]
    verdicts, evidence = made.one(id="claims").all("details")
    _, *rows = verdicts.one("table").cells()
    assert [plain(row[1]) for row in rows] == [words.ours(entry) for entry in entries]
    shares = [percent(part["share"]) for part in ledger["C1"].evidence["statements"]]
    assert [share for _, share in words.statements(ledger["C1"])][:-1] == shares
    assert len(evidence.all("table")) == sum(bool(words.statements(entry)) for entry in entries)


def test_the_answer_has_its_share(made, found):
    assert percent(found.ensemble.box["printed"]["behind"]) in plain(made.one(id="answer").all("p")[0].text)


def test_the_table_of_what_it_depends_on(made, found):
    changes, depends = made.one(id="why").all("table")
    shown = found.ensemble
    assert plain(changes.cells()[1][1]) == percent(shown.box["printed"]["last"])
    printed, last, *rows = [[plain(cell) for cell in row] for row in depends.cells()[1:]]
    assert printed[1] == f"{shown.box['printed']['plants']:,.0f}"
    assert last[4] == percent(shown.box["printed"]["last_diverged_last"])
    others = {
        SHOWN[name]: percent(shown.box[name]["last"])
        for name in SHOWN
        if name in shown.box and name != "printed"
    }
    assert {row[0]: row[4] for row in rows} == others


def test_nothing_is_loaded_from_elsewhere(made, text):
    policy = made.one("meta", **{"http-equiv": "Content-Security-Policy"}).attributes["content"]
    assert policy.startswith("default-src 'none'")
    assert all(element.attributes.get("src", "data:").startswith("data:") for element in made.all())
    assert not {"script", "iframe", "a"} & {element.tag for element in made.all()}
    assert "url(" not in made.one("style").text
    assert len(text.encode()) < 5e6


def test_what_looks_like_html_stands_as_text(made):
    for part in ("compare", "assumptions", "again"):
        assert LIKE_HTML in made.one(id=part).text


def test_equal_contents_give_equal_text(results, text):
    assert page(stored_under(results)) == text


def test_what_was_not_run_names_its_command(tmp_path):
    text = page(stored_under(tmp_path))
    for command in ("tendonrepro decouple", "tendonrepro compare"):
        assert f"<code>{command}</code>" in text
    assert 'id="validate"' not in text


PHONE = """
const all = [...document.querySelectorAll('main *')];
const isText = (node) => node.nodeType === 3 && node.data.trim();
const box = (one) => one.getBoundingClientRect();
const worded = all.filter((one) => [...one.childNodes].some(isText));
const frames = [...document.querySelectorAll('.wide')].filter((one) => one.scrollWidth > one.clientWidth);
return {
  page: document.documentElement.scrollWidth,
  pictures: [...document.images].map((one) => box(one).width),
  outside: all.filter((one) => !one.closest('.wide') && box(one).right > 391).map((one) => one.outerHTML),
  sizes: worded.map((one) => parseFloat(getComputedStyle(one).fontSize)),
  scrolled: frames.map((one) => one.scrollWidth),
  names: frames.flatMap((one) => [...one.querySelectorAll('td:first-child')]).map((one) => box(one).width),
};
"""
"""Widths of a page in pixels: of it, its pictures, and wide tables with the names in their first columns."""


@pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="no chromium with its driver on the path")
def test_a_phone_shows_all_without_scrolling_sideways(results, tmp_path):
    """Tables scroll within themselves, pictures shrink, and words are as large as on any page."""
    folder = shutil.copytree(results, tmp_path / "reports")
    reading = "phi_branch=power+weights=extrapolating+stored_torque=applied+output_delay=1"
    text = f"Caption\n\n|{' number |' * 10}\n|{' --- |' * 10}\n| {reading} |{' 1.2345 |' * 9}\n"
    (folder / "compare" / "tables" / "table2.md").write_text(text, encoding="utf-8")
    figure = folder / "compare" / "figures" / "fig14"
    figure.with_suffix(".svg").unlink()
    Image.new("L", (2000, 900)).save(figure.with_suffix(".png"), dpi=(300, 300))
    (tmp_path / "report.html").write_text(page(stored_under(folder)), encoding="utf-8")
    with Browser() as browser:
        browser.width(390)
        browser.open(tmp_path / "report.html")
        browser.run("document.querySelectorAll('details').forEach((one) => { one.open = true })")
        seen = browser.run(PHONE)
    assert seen["page"] <= 390
    assert seen["outside"] == []
    assert 300 < max(seen["pictures"]) <= 390
    assert min(seen["sizes"]) >= 16.0
    assert max(seen["scrolled"]) > 600
    assert max(seen["names"]) < 200, "numbers stand beside the names"


def test_a_figure_without_svg_is_shown_as_png(tmp_path):
    """As SVG where both are there; a narrow one stays narrow."""
    folder = tmp_path / "figures"
    folder.mkdir()
    for name, width in (("a", 1000), ("b", 2000), ("c", 1000)):
        Image.new("L", (width, 10)).save(folder / f"{name}.png", dpi=(300, 300))
    (folder / "c.svg").write_text("<svg width='9pt'/>", encoding="utf-8")
    plates = [plate(path) for path in pictures(folder)]
    assert [one["narrow"] for one in plates] == [True, False, False]
    assert ["image/svg" in one["address"] for one in plates] == [False, False, True]
