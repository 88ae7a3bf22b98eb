"""The file: small, complete in itself, and never written over something else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import tendonrepro as tr
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.files import sha256_of
from tendonrepro.reporting.live.page import FOLDER

UPLOT = {
    "uplot.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uplot.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}
LARGEST = 200_000
"""Bytes that the page may have."""


def test_the_page_is_small_and_asks_nobody(tmp_path: Path) -> None:
    path = tr.live(out=tmp_path / "live.html")
    text = path.read_text(encoding="utf-8")
    assert len(text.encode()) <= LARGEST
    assert re.search(r"Content-Security-Policy\" content=\"default-src 'none'", text)
    assert re.findall(r"""\b(?:src|href)=["'](?!data:)""", text) == []
    assert "MIT License" in text
    assert tr.live(out=path).read_text(encoding="utf-8") == text


def test_a_motion_from_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "motion.csv").write_text(
        "time_s,q2_deg,q3_deg\n" + "".join(f"{t},{t},{t}\n" for t in range(8)), encoding="utf-8"
    )
    change = {"reference": {"kind": "sampled", "file": str(tmp_path / "motion.csv")}}
    with pytest.raises(UsageError):
        tr.live(out=tmp_path / "live.html", set=change)
    with pytest.raises(ConfigError):
        tr.live("decouple", out=tmp_path / "live.html")
    assert not (tmp_path / "live.html").exists()


def test_another_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "notes.html"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError):
        tr.live(out=path)
    assert path.read_text(encoding="utf-8") == "mine"
    with pytest.raises(UsageError):
        tr.live(out=tmp_path)
    tr.live(out=path, force=True)
    assert path.stat().st_size > 1000
    with pytest.raises(UsageError):
        tr.report(tmp_path, out=path)


def test_the_plotting_library_is_the_stated_one() -> None:
    assert {name: sha256_of(FOLDER / name) for name in UPLOT} == UPLOT
