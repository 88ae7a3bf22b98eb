"""The page of ``tendonrepro live``: presets, their code, scripts and styles, in one HTML file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypedDict

from tendonrepro import __version__
from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import refuse_foreign, write_atomically
from tendonrepro.reporting.live.model import Library
from tendonrepro.reporting.live.preset import preset

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
    for whole in presets:
        short.append(whole if "of" in whole else _changes(whole, before))
        before = before if "of" in whole else whole
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


RAMPS = {
    "reference": {
        "kind": "ramp",
        "amplitude": {"value": [3.4, 8.7], "unit": "deg", "source": "assumed: chosen to come near Table 2"},
        "rise": {"value": 3.6, "unit": "s", "source": "assumed: chosen to come near Table 2"},
        "hold": {"value": 1.4, "unit": "s", "source": "assumed: chosen to come near Table 2"},
        "periods": {"value": 2, "unit": "1", "source": "assumed: as many as as published"},
    },
    "control.readings.reference_acceleration": "absent",
}
"""Straight ramps, whose acceleration no law gets."""

APART = {
    "runs.controller_2.start_offset.2": -1.1,
    "runs.controller_2.start_offset.3": -1.1,
    "runs.controller_3.start_offset.2": -1.8,
    "runs.controller_3.start_offset.3": -1.7,
}
"""Starts, deg, found by a search: with them the typical arm comes near Table 2."""

VARIANTS: Sequence[dict[str, object]] = (
    {
        "name": "apart",
        "of": "ramps",
        "title": "Runs that start apart",
        "about": "The same ramps. Controllers 2 and 3 start one to two degrees below their reference, "
        "Controller 1 starts on it. Ramps and starts were chosen to come near Table 2, so agreement proves "
        "nothing.",
        "values": APART,
    },
    {
        "name": "weights",
        "of": "published",
        "title": "Changed weights",
        "about": "As published, but the two delayed estimates weigh 1 + α and −α: Eq. (15) with a changed "
        "sign.",
        "values": {"control.readings.weights": "extrapolating"},
    },
    {
        "name": "delta_in_degrees",
        "of": "published",
        "title": "Δ in degrees",
        "about": "As published, but Δ = 0.2 is understood in degrees. The paper gives no unit.",
        "values": {"control.readings.Delta_unit": "deg"},
    },
)
"""Presets that are another one with some values changed."""


def shipped_presets(library: Library) -> list[dict[str, object]]:
    """The presets that tell the paper's story; a variant is another preset with some values changed."""
    published = preset(
        load_config(None, "compare"),
        "published",
        "As published",
        "Equations, gains and encoder as published. Arm and motion are assumed: a typical one of plausible "
        "ranges, that of tendonrepro compare. Every run starts on its reference and gets its acceleration.",
        library,
    )
    ramps = preset(
        load_config(None, "compare", overrides=RAMPS),
        "ramps",
        "Straight ramps",
        "The reference is a straight ramp, and its acceleration is not fed forward. The order is as before.",
        library,
    )
    fitted = preset(
        load_config("closest", "compare"),
        "fitted",
        "Fitted arm",
        "An arm and a motion that were fitted to Tables 2 and 3, so agreement proves nothing.",
        library,
    )
    return [published, ramps, *VARIANTS, fitted]


PAGE = "live.html"
"""Name of the page."""

MARK = b'<meta name="generator" content="live page of tendonrepro'
"""What every page has near its beginning."""


class LiveFile(TypedDict):
    """What ``--json`` prints of a page: its file, size, and names of its presets."""

    schema_version: int
    path: str
    bytes: int
    presets: list[str]


def write_page(path: Path, loaded: LoadedConfig | None, *, force: bool) -> LiveFile:
    """Write the page, a user's configuration among its presets; return what ``--json`` prints.

    It replaces an earlier page, any other file with `force` alone.

    Raises
    ------
    UsageError
        If another file is in the way, or the page cannot run the configuration.
    """
    refuse_foreign(path, MARK, force=force)
    library = Library()
    presets = shipped_presets(library)
    if loaded is not None:
        about = f"The configuration {Path(loaded.origin).name}, with its own arm, gains and motion."
        presets.insert(0, preset(loaded, "own", "Your configuration", about, library))
    content = build_page(presets, library).encode()
    write_atomically(path, content)
    names = [str(made["name"]) for made in presets]
    return {"schema_version": 1, "path": str(path), "bytes": len(content), "presets": names}


def page_beside(path: Path, loaded: LoadedConfig | None, talk: Talk, *, force: bool) -> LiveFile:
    """Write the page; it has no preset of a user's own configuration that it cannot run."""
    try:
        return write_page(path, loaded, force=force)
    except UsageError as error:
        talk.note(f"{path.name} has no preset of your configuration: {error.message}")
        return write_page(path, None, force=force)


def live_text(page: LiveFile) -> str:
    """What the terminal says."""
    return f"{page['path']}: {page['bytes'] / 1e3:.0f} kB, open it in a browser"
