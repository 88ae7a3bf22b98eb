"""One folder of made-up results, hostile texts in it, and the page of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from support.html_page import Element, read_page
from support.synthetic import make_compare_file, make_decouple_file

from tendonrepro.console import Talk
from tendonrepro.report.page import page
from tendonrepro.report.sources import Found, found_under
from tendonrepro.results.traces import write_traces

HOSTILE = "<script>alert(1)</script><img src=//evil.example/x onerror=alert(2)>\"'&"
"""What must stand on the page as it stands here, and do nothing."""

STATICS = {
    "of_paper": True,
    "postures": 10,
    "tensioner_force_N": 17.0,
    "payload_kg": 0.2,
    "courses": {
        HOSTILE: {
            "change_of_length_mm": 61.2,
            "half_plane": {"motor": {"share_tense": 0.5, "least_tension_N": 3.25, "tendon": 2}},
        }
    },
}


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    compare = replace(
        make_compare_file(step=0.01),
        config_yaml=f"note: {{value: 1, unit: '1', source: 'assumed: {HOSTILE.replace(chr(39), '')}'}}\n",
        manifest_json=json.dumps({"overrides": [HOSTILE], "config": {"origin": "compare.yaml"}}),
    )
    write_traces(folder / "compare" / "traces.h5", compare)
    write_traces(folder / "decouple" / "traces.h5", make_decouple_file(step=0.01))
    (folder / "statics" / "figures").mkdir(parents=True)
    (folder / "statics" / "statics.json").write_text(json.dumps(STATICS), encoding="utf-8")
    drawing = f"<svg xmlns='http://www.w3.org/2000/svg'><script>alert(3)</script><desc>{HOSTILE}</desc></svg>"
    (folder / "statics" / "figures" / "statics_map.svg").write_text(drawing, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def found(results: Path) -> Found:
    held = found_under(results, None, Talk(quiet=True))
    held.verdicts = [replace(one, printed=HOSTILE) if one.id == "C4" else one for one in held.verdicts]
    return held


@pytest.fixture(scope="session")
def text(found: Found) -> str:
    return page(found)


@pytest.fixture(scope="session")
def made(text: str) -> Element:
    return read_page(text)
