"""Score of a mutation run: `make mutants` lets mutmut plant its faults, then lists here what was noticed."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

CAUGHT = {"killed", "timeout"}


def outcomes() -> list[tuple[str, str, str]]:
    """Module, function with the number of its mutant, and outcome, of all mutants that were tried."""
    mutmut = Path(sys.executable).with_name("mutmut")
    listing = subprocess.run([mutmut, "results", "--all", "true"], capture_output=True, text=True, check=True)
    return re.findall(
        r"^\s*tendonrepro\.(?:physics\.)?(\w+)\.(\S+): (?!not checked)(.+)$", listing.stdout, re.M
    )


def report(results: list[tuple[str, str, str]]) -> str:
    planted = Counter(module for module, _, _ in results)
    caught = Counter(module for module, _, outcome in results if outcome in CAUGHT)
    rows = [(module, caught[module], planted[module]) for module in sorted(planted)]
    rows.append(("all", caught.total(), planted.total()))
    lines = [f"{module:12}{found:5} of {count:4}{found / count:8.1%}" for module, found, count in rows]
    missed = [f"{module}.{name}: {outcome}" for module, name, outcome in results if outcome not in CAUGHT]
    return "\n".join([*lines, "", *missed, ""])


if __name__ == "__main__":
    sys.stdout.write(report(outcomes()))
