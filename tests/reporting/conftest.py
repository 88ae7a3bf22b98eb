"""One folder of made-up results, texts like HTML in it, and the page of it."""

import json

import pytest
from support.html_page import read_page

from tendonrepro.reporting.page import page, stored_under

LIKE_HTML = "a<b & <i>c</i>"
"""What a user writes into a title, a source or a table stands on the page as it is."""


def write_experiment(folder, name, figures):
    """What the page reads of an experiment."""
    (folder / name / "figures").mkdir(parents=True)
    (folder / name / "tables").mkdir()
    for figure in figures:
        svg = "<svg xmlns='http://www.w3.org/2000/svg'><script/></svg>"
        path = folder / name / "figures" / f"{figure}.svg"
        path.write_text(svg, encoding="utf-8")
        path.with_suffix(".txt").write_text(f"About {figure}\n\nMade up.\n", encoding="utf-8")
    for table in ("table1", "table2", "table3"):
        text = f"Caption of {table}\n\n| a | b |\n| --- | ---: |\n| {LIKE_HTML} | 2 |\n"
        (folder / name / "tables" / f"{table}.md").write_text(text, encoding="utf-8")
    mass = {"value": 1, "unit": "kg", "source": f"assumed: {LIKE_HTML}"}
    manifest = {
        "config": {"origin": name, "sha256": "0" * 64, "tree": {"mass": mass}},
        "overrides": [f"title={LIKE_HTML}"],
        "created": "2027-01-02T03:04:05+00:00",
        "tendonrepro_version": "0.1.0",
    }
    (folder / name / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    write_experiment(folder, "decouple", ("fig06", "fig09", "fig10"))
    write_experiment(folder, "compare", ("fig13", "fig14"))
    return folder


@pytest.fixture(scope="session")
def found(results):
    return stored_under(results)


@pytest.fixture(scope="session")
def text(found):
    return page(found)


@pytest.fixture(scope="session")
def made(text):
    return read_page(text)
