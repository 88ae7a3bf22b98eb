"""The notebook of examples runs and shows what it showed; the tutorial has its first cell."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import ROOT
from support.pages import DOCS, NEEDS_DOCS

pytestmark = NEEDS_DOCS
NOTEBOOK = ROOT / "examples" / "notebook.ipynb"

# In a process of its own: the libraries of notebooks warn of their future, and here a warning is an error.
EXECUTE = """
import sys
import nbformat
from nbclient import NotebookClient

held = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(held, timeout=300, kernel_name="python3").execute()
nbformat.write(held, sys.argv[2])
"""


def shown(path: Path) -> list[dict[str, Any]]:
    """What each cell with code showed, by kind."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    outputs = [cell["outputs"] for cell in cells if cell["cell_type"] == "code"]
    return [
        {
            kind: "".join(text)
            for one in held
            for kind, text in (one.get("data") or {"text": one["text"]}).items()
        }
        for held in outputs
    ]


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"(?<![\w.])\d+\.\d+", text)]


@pytest.mark.slow
def test_the_notebook_runs_and_shows_the_same(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", EXECUTE, NOTEBOOK, tmp_path / "run.ipynb"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    now, stored = shown(tmp_path / "run.ipynb"), shown(NOTEBOOK)
    assert [set(held) for held in now] == [set(held) for held in stored]
    assert "image/png" in now[1], "the figure did not show itself"
    for ours, kept in zip(now, stored, strict=True):
        for kind in ours.keys() - {"image/png"}:
            # The last digit is left free.
            np.testing.assert_allclose(numbers(ours[kind]), numbers(kept[kind]), atol=0.002)


def test_the_tutorial_shows_its_first_cell() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    first = next("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    assert f"```python\n{first}\n```" in (DOCS / "tutorial.md").read_text(encoding="utf-8")
