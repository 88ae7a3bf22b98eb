"""The page of ``tendonrepro live``: presets, their code, scripts and styles, in one HTML file."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from tendonrepro import __version__
from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import Json, refuse_foreign, write_atomically
from tendonrepro.reporting.live.model import Library
from tendonrepro.reporting.live.preset import preset

FOLDER = Path(__file__).parent / "page"
"""With ``dist/uPlot.iife.min.js`` and ``dist/uPlot.min.css`` of npm's uPlot 1.6.32, unchanged."""


def build_page(presets: Sequence[Json], library: Library) -> str:
    """The HTML file."""
    # Presets repeat each other, so they are packed.
    data = gzip.compress(json.dumps(presets).encode(), mtime=0)
    parts = {
        "UPLOT_STYLE": _file("uplot.css"),
        "STYLE": _compact("page.css"),
        "ENGINE": f"{_compact('engine.js')}\n{library.source()}",
        "UPLOT_CODE": f"/*\n{_file('uplot-LICENSE')}*/\n{_file('uplot.js')}",
        "DATA": base64.b64encode(data).decode("ascii"),
        "PAGE_CODE": _compact("page.js"),
        "VERSION": __version__,
    }
    return re.sub("|".join(parts), lambda word: parts[word[0]], _file("page.html"))


def _file(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _compact(name: str) -> str:
    """A script or style sheet without indentation and lines of comment."""
    return re.sub(r"^(\s+|//.*\n)+", "", _file(name), flags=re.M)


NEAR = "assumed: chosen to come near Table 2"
RAMPS: Mapping[str, object] = {
    "reference": {
        "kind": "ramp",
        "amplitude": {"value": [3.4, 8.7], "unit": "deg", "source": NEAR},
        "rise": {"value": 3.6, "unit": "s", "source": NEAR},
        "hold": {"value": 1.4, "unit": "s", "source": NEAR},
        "periods": {"value": 2, "unit": "1", "source": "assumed: as many as as published"},
    },
    "control.readings.reference_acceleration": "absent",
}
"""Straight ramps, whose acceleration no law gets."""

APART: Mapping[str, object] = {
    "runs.controller_2.start_offset": {"value": [-1.1, -1.1], "unit": "deg", "source": NEAR},
    "runs.controller_3.start_offset": {"value": [-1.8, -1.7], "unit": "deg", "source": NEAR},
}
"""Starts found by a search: with them the typical arm comes near Table 2."""

SHIPPED: Sequence[tuple[str, str, str, str | None, Mapping[str, object]]] = (
    (
        "published",
        "As published",
        "Equations, gains and encoder as published. Arm and motion are assumed: a typical one of plausible "
        "ranges, that of tendonrepro compare. Every run starts on its reference and gets its acceleration.",
        None,
        {},
    ),
    (
        "ramps",
        "Straight ramps",
        "The reference is a straight ramp, and its acceleration is not fed forward. The order is as before.",
        None,
        RAMPS,
    ),
    (
        "apart",
        "Runs that start apart",
        "The same ramps. Controllers 2 and 3 start one to two degrees below their reference, Controller 1 "
        "starts on it. Ramps and starts were chosen to come near Table 2, so agreement proves nothing.",
        None,
        {**RAMPS, **APART},
    ),
    (
        "weights",
        "Changed weights",
        "As published, but the two delayed estimates weigh 1 + α and −α: Eq. (15) with a changed sign.",
        None,
        {"control.readings.weights": "extrapolating"},
    ),
    (
        "delta_in_degrees",
        "Δ in degrees",
        "As published, but Δ = 0.2 is understood in degrees. The paper gives no unit.",
        None,
        {"control.readings.Delta_unit": "deg"},
    ),
    (
        "fitted",
        "Fitted arm",
        "An arm and a motion that were fitted to Tables 2 and 3, so agreement proves nothing.",
        "closest",
        {},
    ),
)
"""Name, title and words of the presets that tell the paper's story; their configuration and its changes."""


PAGE = "live.html"
"""Name of the page."""

MARK = b'<meta name="generator" content="live page of tendonrepro'
"""What every page has near its beginning."""


def write_page(path: Path, loaded: LoadedConfig | None, *, force: bool) -> Json:
    """Write the page, a user's configuration among its presets; return what ``--json`` prints.

    It replaces an earlier page, any other file with `force` alone.

    Raises
    ------
    UsageError
        If another file is in the way, or the page cannot run the configuration.
    """
    refuse_foreign(path, MARK, force=force)
    library, presets = Library(), []
    if loaded is not None:
        about = f"The configuration {Path(loaded.origin).name}, with its own arm, gains and motion."
        presets.append(preset(loaded, "own", "Your configuration", about, library))
    for name, title, about, config, changes in SHIPPED:
        shipped = load_config(config, "compare", overrides=changes)
        presets.append(preset(shipped, name, title, about, library))
    content = build_page(presets, library).encode()
    write_atomically(path, content)
    names = [made["name"] for made in presets]
    return {"schema_version": 1, "path": str(path), "bytes": len(content), "presets": names}


def page_beside(path: Path, loaded: LoadedConfig | None, talk: Talk, *, force: bool) -> Json:
    """Write the page; it has no preset of a user's own configuration that it cannot run."""
    try:
        return write_page(path, loaded, force=force)
    except UsageError as error:
        talk.note(f"{path.name} has no preset of your configuration: {error.message}")
        return write_page(path, None, force=force)
