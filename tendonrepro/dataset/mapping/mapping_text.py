"""How a suggested mapping is written: YAML that a user can read and mend line by line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping

from tendonrepro.config.fields.strict_yaml import Node
from tendonrepro.dataset.meaning.assignment import RUNS
from tendonrepro.dataset.meaning.words import printable

_PLAIN = {"variable", "unit", "method"}
_UNWRITABLE = re.compile("[\0\ud800-\udfff]")
"""What no mapping can hold: NUL, and halves of a pair that stand for bytes of no known encoding."""


def yaml_lines(tree: Mapping[str, Node], depth: int) -> Iterator[str]:
    """Write a mapping as YAML with one key a line, so that a line can be deleted.

    Parameters
    ----------
    tree : mapping
        Of plain values, mappings, and lists of mappings.
    depth : int
        Blanks before each line.

    Yields
    ------
    str
    """
    indent = " " * depth
    for key, value in tree.items():
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from yaml_lines(value, depth + 2)
        elif isinstance(value, list):
            yield f"{indent}{key}:"
            for item in value:
                assert isinstance(item, dict)
                first, *rest = yaml_lines(item, depth + 2)
                yield f"{indent}- {first.strip()}"
                yield from rest
        else:
            plain = not isinstance(value, str) or (key in _PLAIN and value.isascii())
            yield f"{indent}{key}: {value if plain else quoted(str(value))}"


def quoted(text: str) -> str:
    """Write a text so that YAML gives it back, as far as it can hold it."""
    # A text in JSON is one in YAML too, as far as YAML takes its characters as they are.
    written = json.dumps(_UNWRITABLE.sub("\ufffd", text), ensure_ascii=False)
    return "".join(letter if letter.isprintable() else _escaped(ord(letter)) for letter in written)


def _escaped(code: int) -> str:
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def head_lines(remarks: Iterable[str]) -> list[str]:
    """Comments above a mapping: what to do with it, and what to decide."""
    lines = [
        "Which column is which variable of which run. Guessed by `tendonrepro inspect --suggest`.",
        "Check every entry: variable, joint, unit. Delete its line `because` when you have;",
        "what is left is listed in the result as guessed.",
        f"Runs are {', '.join(RUNS[:-1])} and {RUNS[-1]}.",
    ]
    return [*(f"# {line}" for line in [*lines, *(f"DECIDE: {printable(remark)}" for remark in remarks)]), ""]


def skeleton_lines(example: Node) -> list[str]:
    """A run in comments, for a mapping without any.

    Parameters
    ----------
    example : Node
        An entry under its `signals`.
    """
    time: Node = {"file": "FILE", "signal": "SIGNAL", "column": 1, "unit": "s"}
    run: Node = {"controller_1": {"payload_mass_kg": 0.0, "time": time, "signals": [example]}}
    assert isinstance(run, dict)
    lines = ["No run was found. Take this one, name files and signals as below, and delete the #:"]
    return [f"# {line}" for line in [*lines, *yaml_lines(run, 1)]]
