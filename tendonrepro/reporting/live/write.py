"""What ``tendonrepro live`` does."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import refuse_foreign, write_atomically
from tendonrepro.reporting.live.library import Library
from tendonrepro.reporting.live.page import build_page
from tendonrepro.reporting.live.preset import preset
from tendonrepro.reporting.live.story import shipped_presets

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
    names = [str(preset["name"]) for preset in presets]
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
