"""The page: presets, their code, scripts and styles, in one HTML file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from tendonrepro import __version__
from tendonrepro.reporting.live.library import Library

FOLDER = Path(__file__).parent / "page"

UPLOT = {
    "uplot.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uplot.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}
"""SHA-256 of ``dist/uPlot.iife.min.js`` and ``dist/uPlot.min.css`` of npm's uPlot 1.6.32, unchanged."""


def build_page(presets: Sequence[dict[str, object]], library: Library) -> str:
    """The HTML file."""
    short: list[Mapping[str, object]] = []
    before: Mapping[str, object] = {}
    for preset in presets:
        short.append(preset if "of" in preset else _changes(preset, before))
        before = before if "of" in preset else preset
    parts = {
        "UPLOT_STYLE": _file("uplot.css"),
        "STYLE": _compact("page.css"),
        "ENGINE": f"{_compact('engine.js')}\n{library.source()}",
        "UPLOT_CODE": f"/*\n{_file('uplot-LICENSE')}*/\n{_file('uplot.js')}",
        "DATA": _script_json({"knobs": _knobs(library.knobs), "presets": short}),
        "PAGE_CODE": _compact("page.js"),
        "VERSION": __version__,
    }
    return re.sub("|".join(parts), lambda word: parts[word[0]], _file("page.html"))


def _knobs(knobs: Sequence[dict[str, object]]) -> list[dict[str, object]]:
    """What each changes in the latest of its key, else in the one before; the key stands where it changes."""
    short: list[dict[str, object]] = []
    before: dict[str, object] = {}
    latest: dict[object, dict[str, object]] = {}
    for knob in knobs:
        key = knob["key"]
        changes = _changes(knob, latest.get(key, before))
        short.append(changes if before.get("key") == key else {"key": key, **changes})
        latest[key] = before = knob
    return short


def _changes(tree: Mapping[str, object], first: Mapping[str, object]) -> dict[str, object]:
    """What to lay over another mapping for this one; None takes a key away."""
    changes: dict[str, object] = {key: None for key in first if key not in tree}
    for key, value in tree.items():
        before = first.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            if inner := _changes(value, before):
                changes[key] = inner
        elif value != before:
            changes[key] = value
    return changes


def _script_json(data: object) -> str:
    """JSON that neither ends a script nor begins a comment or another script in it."""
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _file(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _compact(name: str) -> str:
    """A script or style sheet without indentation and lines of comment."""
    return re.sub(r"^(\s+|//.*\n)+", "", _file(name), flags=re.M)
