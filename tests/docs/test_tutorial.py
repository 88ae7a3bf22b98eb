"""The tutorial as a reader does it: its commands in their order, what they print beside what the page shows."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support import ROOT

PAGE = ROOT / "docs" / "tutorial.md"
# Integers are compared as text; of the others the last digit may differ, and 2 %: where machines round
# differently an encoder count falls elsewhere and changes what follows.
NUMBER = r"(?<![\w.])-?\d+\.\d+(?![\w.])"
SHARE = 0.02
DIFFERENT = 1
"""Exit code of ``diff`` for two results that differ."""


def steps(text: str) -> Iterator[tuple[str, list[str]]]:
    """Commands of the page, each with the lines shown below it."""
    for block in re.findall(r"^```console\n(.*?)^```", text, re.S | re.M):
        for step in re.split(r"^\$ ", block, flags=re.M)[1:]:
            command, *shown = step.splitlines()
            yield command, shown


def agrees(shown: str, printed: str) -> bool:
    """Whether a printed line is the shown one: blanks count as one, numbers within their tolerance."""
    words, others = (re.split(f"({NUMBER})", " ".join(line.split())) for line in (shown, printed))
    return len(words) == len(others) and all(
        close(one, other) if k % 2 else one == other
        for k, (one, other) in enumerate(zip(words, others, strict=True))
    )


def close(shown: str, printed: str) -> bool:
    digit = 10.0 ** -len(shown.partition(".")[2])
    return abs(float(shown) - float(printed)) <= 1.001 * max(digit, SHARE * abs(float(shown)))


def unmatched(shown: list[str], printed: list[str]) -> str | None:
    """First shown line that is not printed in its place; ``...`` stands for any lines."""
    rest, anywhere = iter(printed), False
    for line in shown:
        if line == "...":
            anywhere = True
        elif anywhere:
            if not any(agrees(line, other) for other in rest):
                return line
            anywhere = False
        elif not agrees(line, next(rest, "")):
            return line
    return None if anywhere or not any(line.strip() for line in rest) else "..."


def test_a_wrong_line_is_noticed() -> None:
    printed = ["a  1.00 | 3", "b 0.014", "c"]
    assert unmatched(["a 1.01 | 3", "...", "c"], printed) is None
    assert unmatched(["a 1.00 | 3", "b 0.015", "c"], printed) is None
    assert unmatched(["a 1.03 | 3", "..."], printed) == "a 1.03 | 3"
    assert unmatched(["a 1.00 | 4", "..."], printed) == "a 1.00 | 4"
    assert unmatched(["...", "b 0.016", "c"], printed) == "b 0.016"
    assert unmatched(["...", "d"], printed) == "d"
    assert unmatched(["a 1.00 | 3", "b 0.014"], printed) == "..."


@pytest.mark.slow
@pytest.mark.skipif(not PAGE.exists(), reason="no docs folder beside the package")
def test_the_commands_print_what_the_page_shows(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    for command, shown in steps(PAGE.read_text(encoding="utf-8")):
        program, *words = shlex.split(command)
        assert program == "tendonrepro"
        done = subprocess.run(
            [sys.executable, "-m", program, *words],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        assert done.returncode == (DIFFERENT if words[0] == "diff" else 0), done.stderr
        missed = unmatched(shown, done.stdout.splitlines())
        assert missed is None, f"$ {command}\nnot printed in its place: {missed}\n{done.stdout}"
