"""From guesses to a mapping file that a user can read, confirm and mend."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from tendonrepro.dataset.columns import Address, Column
from tendonrepro.dataset.units import FACTORS, kind_of_variable
from tendonrepro.records import VARIABLES
from tendonrepro.strict_yaml import Node

PAYLOAD = 0.2
"""The paper's payload, kg, where a name says that there is one but not how heavy."""
DECOUPLE = "decouple"

_VARIABLE = {
    "measured": "q_encoder",
    "desired": "q_d",
    "error": "e",
    "motor": "q_motor_encoder",
    "calculated": "q_calculated",
    "torque": "tau_m",
    "estimate": "H_hat",
    "surface": "s",
    "rate": "dq",
    "acceleration": "ddq",
}
_SHIFTED = "only joints 1 and 2 appear, so they are taken for 2 and 3, as in section 5.4"
_PLAIN = {"variable", "unit"}
_OF_DESIRED = {"rate": "dq_d", "acceleration": "ddq_d"}


@dataclass(frozen=True)
class Suggestion:
    """A mapping to begin with.

    Attributes
    ----------
    text : str
        YAML with comments.
    runs : dict
        Run name -> how many columns it has.
    left : tuple of Column
        Columns that are in no run.
    """

    text: str
    runs: Mapping[str, int]
    left: tuple[Column, ...]


def variable_of(column: Column) -> str | None:
    """Variable of a run that a column holds; None when it is none, or nothing is known."""
    if column.quantity is None or column.quantity == "time":
        return None
    about_motor = column.own.of_motor and column.quantity != "motor"
    # Motor angles from the desired joint angles are computed again, they are no measurement.
    if about_motor and column.quantity != "torque":
        return None
    if column.quantity == "motor" and column.own.desired:
        return None
    if column.own.desired:
        return _OF_DESIRED.get(column.quantity, _VARIABLE[column.quantity])
    return _VARIABLE[column.quantity]


def _run_of(column: Column, decoupling: Iterable[tuple[str, str, int]]) -> str:
    """Name of the run of a column; `decoupling` are groups that hold that experiment by what is in them."""
    payload, controller = column.payload_mass, column.controller
    if controller is None and (
        any(name.decoupling for name in column.names)
        or (column.figure is not None and column.figure <= 12)
        or column.group in decoupling
    ):
        return DECOUPLE
    if controller is None and (payload is not None or column.figure == 16):
        # Table 3 and Figure 16 are of Controller 1.
        controller = 1
    if controller is None:
        return _slug(PurePosixPath(column.source.name).stem)
    loaded = payload is not None and payload != 0.0
    return f"controller_{controller}{'_payload' if loaded else ''}"


def _slug(text: str) -> str:
    words = "_".join(re.findall(r"[a-z0-9]+", text.lower()))
    return words if re.match(r"[a-z]", words) and words != "plant" else f"run_{words}".rstrip("_")


def suggest(columns: Sequence[Column], title: str) -> Suggestion:
    """Write a mapping from guesses.

    Parameters
    ----------
    columns : sequence of Column
        As `meaning.understand` leaves them.
    title : str
        For the mapping.

    Returns
    -------
    Suggestion
    """
    runs = runs_among(columns)
    shifted = _counted_from_one(runs)
    chosen = {name: _chosen(members) for name, members in runs.items()}
    axes = {column.address: _axis(column) for column in columns if column.quantity == "time"}
    body = ["schema_version: 1", f"title: {_quoted(title)}", "runs:"]
    for name, picked in chosen.items():
        run = _described_run(name, runs[name], picked, axes, shift=shifted and name != DECOUPLE)
        body += [f"  {name}:", *_lines(run, 4)]
    taken = {column for picked in chosen.values() for column in picked}
    left = tuple(column for column in columns if column not in taken and column.quantity != "time")
    text = "\n".join([*_head(chosen), *body, *_rest(left), ""])
    return Suggestion(text, {name: len(picked) for name, picked in chosen.items()}, left)


def _axis(column: Column) -> Node:
    return {**column.address._asdict(), "unit": column.unit or "s"}


def _lines(tree: Mapping[str, Node], depth: int) -> Iterator[str]:
    """A mapping as YAML with one key a line, so that a line can be deleted."""
    indent = " " * depth
    for key, value in tree.items():
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from _lines(value, depth + 2)
        elif isinstance(value, list):
            yield f"{indent}{key}:"
            for item in value:
                assert isinstance(item, dict)
                first, *rest = _lines(item, depth + 2)
                yield f"{indent}- {first.strip()}"
                yield from rest
        else:
            plain = not isinstance(value, str) or (key in _PLAIN and value.isascii())
            yield f"{indent}{key}: {value if plain else _quoted(str(value))}"


def _quoted(text: str) -> str:
    # A text in JSON is one in YAML too.
    return json.dumps(text, ensure_ascii=False)


def runs_among(columns: Sequence[Column]) -> dict[str, list[Column]]:
    """Columns that are variables of a run, by its name.

    A column without a controller is shared by the runs of its own table.
    """
    columns = [column for column in columns if variable_of(column) and column.joint]
    decoupling = {
        column.group
        for column in columns
        if column.quantity in {"calculated", "motor"} or (column.quantity == "measured" and column.joint == 1)
    }
    # Where joints 2 and 3 are called 1 and 2, joint 1 alone does not tell the experiments apart.
    if not any(column.joint == 3 for column in columns):
        decoupling = set()
    found: dict[str, list[Column]] = {}
    named: dict[tuple[str, str, int], list[str]] = {}
    for column in columns:
        if column.controller is not None:
            names = named.setdefault(column.group, [])
            names += [name for name in [_run_of(column, decoupling)] if name not in names]
    for column in columns:
        shared = named.get(column.group, []) if column.controller is None else []
        for name in shared or [_run_of(column, decoupling)]:
            found.setdefault(name, []).append(column)
    return dict(sorted(found.items()))


def _counted_from_one(runs: Mapping[str, Sequence[Column]]) -> bool:
    """Whether the comparison calls joints 2 and 3 by 1 and 2, as the paper's section 5.4 does."""
    joints = {column.joint for name, members in runs.items() if name != DECOUPLE for column in members}
    return bool(joints) and joints <= {1, 2}


def _chosen(members: Sequence[Column]) -> list[Column]:
    """One column for each variable and joint: the first."""
    found: dict[tuple[str | None, int | None], Column] = {}
    for column in members:
        found.setdefault((variable_of(column), column.joint), column)
    return sorted(found.values(), key=lambda column: (variable_of(column) or "", column.joint or 0))


def _described_run(
    name: str,
    members: Sequence[Column],
    chosen: Sequence[Column],
    axes: Mapping[Address, Node],
    *,
    shift: bool,
) -> dict[str, Node]:
    masses = [column.payload_mass for column in members if column.payload_mass is not None]
    mass = next((mass for mass in masses if mass), 0.0) if name.endswith("_payload") else 0.0
    run: dict[str, Node] = {"payload_mass_kg": PAYLOAD if math.isnan(mass) else mass}
    times = {column.time for column in chosen}
    common = times.pop() if len(times) == 1 else None
    if common is not None:
        run["time"] = axes[common]
    entries: list[Node] = []
    for column in chosen:
        entry = _described(column, shift=shift)
        if common is None and column.time is not None:
            entry["time"] = axes[column.time]
        entries.append(entry | {"because": "; ".join(column.because)})
    return run | {"signals": entries}


def _described(column: Column, *, shift: bool) -> dict[str, Node]:
    variable = variable_of(column)
    assert variable is not None
    assert column.joint is not None
    known = FACTORS.get(kind_of_variable(VARIABLES[variable][0]) or "", {})
    unit = column.unit if column.unit in known or not known else next(iter(known))
    if shift and _SHIFTED not in column.because:
        column.because.append(_SHIFTED)
    entry: dict[str, Node] = {"variable": variable, "joint": column.joint + int(shift)}
    entry |= {**column.address._asdict(), "unit": unit or "rad"}
    if column.scale != 1.0:
        entry["scale"] = column.scale
    return entry


def _head(runs: Iterable[str]) -> list[str]:
    unnamed = [name for name in runs if not re.fullmatch(r"controller_[123](_payload)?|decouple", name)]
    lines = [
        "# Which column is which variable of which run. Guessed by `tendonrepro inspect --suggest`.",
        "# Check every entry: variable, joint, unit. Delete its line `because` when you have;",
        "# what is left is listed in the result as guessed.",
        "# Runs are controller_1, controller_2, controller_3, controller_1_payload and decouple.",
    ]
    lines += [f"# Rename the run {name!r}: no name says which controller it is." for name in unnamed]
    return [*lines, ""]


def _rest(left: Sequence[Column]) -> list[str]:
    if not left:
        return []
    lines = ["", "# In no run; copy what you need into one:"]
    for column in left:
        file, signal, number = column.address
        guess = f"{column.quantity}, joint {column.joint or '?'}" if column.quantity else "not understood"
        lines.append(f"#   file: {file}, signal: {signal}, column: {number}  ({guess})")
    return lines
