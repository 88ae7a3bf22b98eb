"""Pages as a reader follows them: their commands in order, what they print beside what the page shows."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from support import ROOT
from support.command import run

PAGES = [ROOT / "docs" / name for name in ("tutorial.md", "cli.md")]
"""Run in one folder, one after the other."""
# Integers are compared as text; of the others the last digit may differ, and 2 %: where machines round
# differently an encoder count falls elsewhere and changes what follows.
NUMBER = r"(?<![\w.])-?\d+\.\d+(?![\w.])"
SHARE = 0.02
DIFFERENT = 1
"""Exit code of ``diff`` for two results that differ; above it something is wrong."""


def steps(text: str) -> Iterator[tuple[str, list[str]]]:
    """Commands of the page, each with the lines shown below it."""
    for block in re.findall(r"^```console\n(.*?)^```", text, re.S | re.M):
        for step in re.split(r"^\$ ", block, flags=re.M)[1:]:
            command, *shown = step.splitlines()
            yield command, shown


def agrees(shown: str, printed: str) -> bool:
    """Whether a printed line is the shown one: blanks count as one, numbers within their tolerance."""
    shown, printed = (" ".join(line.split()) for line in (shown, printed))
    parts = re.split(rf"({NUMBER}|\.\.\.)", shown)
    numbers = [part for part in parts[1::2] if part != "..."]
    kinds = {"...": ".*"} | dict.fromkeys(numbers, f"({NUMBER})")
    pattern = "".join(kinds[part] if k % 2 else re.escape(part) for k, part in enumerate(parts))
    found = re.fullmatch(pattern, printed)
    return found is not None and all(map(close, numbers, found.groups()))


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


@pytest.mark.slow
@pytest.mark.skipif(not PAGES[0].exists(), reason="no docs folder beside the package")
def test_commands_print_what_the_pages_show(tmp_path: Path) -> None:
    for page in PAGES:
        for command, shown in steps(page.read_text(encoding="utf-8")):
            done = run(*shlex.split(command)[1:], cwd=tmp_path, columns=200)
            told = done.stderr if done.returncode > DIFFERENT else ""
            printed = (told + done.stdout).splitlines()
            text = "\n".join(shown)
            diverges, mistake = "diverged" in text, text.startswith(("error", '{"error"'))
            expected = {5} if diverges else {2, 4} if mistake else {int("diff" in command.split())}
            missed = unmatched(shown, printed)
            assert missed is None, f"$ {command}\nnot printed in its place: {missed}\n" + "\n".join(printed)
            assert done.returncode in expected, command
