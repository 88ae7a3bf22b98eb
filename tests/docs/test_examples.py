"""The examples of the tutorial run from anywhere, and each makes its picture."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image
from support import ROOT
from support.pages import DOCS, NEEDS_DOCS

pytestmark = NEEDS_DOCS
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))


def test_the_tutorial_names_every_example() -> None:
    text = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    assert {*re.findall(r"\(\.\./examples/(\w+)\.py\)", text)} == {*EXAMPLES}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_and_draws(name: str, tmp_path: Path) -> None:
    script = ROOT / "examples" / f"{name}.py"
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with Image.open(tmp_path / f"{name}.png") as image:
        assert min(image.size) > 300
