"""The stored results of these pages: one file each, below ``docs/results``."""

from __future__ import annotations

import csv
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
RESULTS = DOCS / "results"


def read(path: Path) -> Any:
    """Content of a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))


def stored(name: str) -> Any:
    """Content of a stored result."""
    return read(RESULTS / f"{name}.json")


def store(name: str, content: Any) -> None:
    """Store with six digits."""
    write(name, rounded(content))


def write(name: str, content: Any) -> None:
    """Store to the last digit."""
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    (RESULTS / name).write_text(text, encoding="utf-8")


def store_table(name: str, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Store rows with six digits; what is unknown is empty."""
    RESULTS.mkdir(exist_ok=True)
    with (RESULTS / name).open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, columns, lineterminator="\n")
        table.writeheader()
        table.writerows(rounded(dict(row)) for row in rows)


def rounded(content: Any) -> Any:
    """Six digits are more than any of these numbers is worth, and keep the file small."""
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [rounded(value) for value in content]
    return float(f"{content:.6g}") if isinstance(content, float) else content


def nearest(readings: Sequence[Mapping[str, Any]], names: Collection[str]) -> Mapping[str, Any] | None:
    """The closest plant under some interpretations."""
    held = [reading for reading in readings if reading["name"] in names]
    return min(held, key=lambda reading: reading["misfit_log"], default=None)


def of_joints(names: Iterable[str]) -> list[str]:
    """Interpretations whose errors are of joints: with motor encoders in the loop they are of motors."""
    return [name for name in names if "feedback=motor" not in name.split("+")]
