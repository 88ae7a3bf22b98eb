"""Tables that hold runs or joints below each other, cut by the columns that say which is which."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.meaning.columns import SHORTEST, Column, Group, Rows
from tendonrepro.dataset.meaning.evidence import is_label
from tendonrepro.dataset.meaning.words import CONTROLLER, Hints, tokens

MOST_PARTS = 60
"""Parts of a table; one with more is not cut."""
_JOINT = frozenset({"joint", "axis", "关节"})
_TRIAL = frozenset({"trial", "run", "test", "exp", "experiment", "repetition", "repeat", "rep", "case"})
_Role: TypeAlias = Literal["joint", "controller", "load", "trial"]


def cut_long_tables(columns: Iterable[Column]) -> list[Column]:
    """Replace columns of tables in long form by one for each run and joint.

    Parameters
    ----------
    columns : iterable of Column
        As `columns.columns_of` finds them.

    Returns
    -------
    list of Column
        Those of other tables as they are.
    """
    groups: dict[Group, list[Column]] = defaultdict(list)
    for column in columns:
        groups[column.group].append(column)
    return [column for group in groups.values() for column in _cut(group)]


def _cut(group: Sequence[Column]) -> Iterator[Column]:
    found = ((column, _role(column)) for column in group) if _restarts(group) else ()
    roles = {column: role for column, role in found if role is not None}
    if not {"joint", "controller"}.intersection(roles.values()):
        yield from group
        return
    table = np.stack([label.values for label in roles], axis=1)
    parts, place = np.unique(table, axis=0, return_inverse=True)
    if len(parts) > MOST_PARTS:
        yield from group
        return
    yield from roles
    for number, part in enumerate(parts.tolist()):
        rows = _rows(place.reshape(-1) == number, dict(zip(roles, part, strict=True)), roles)
        if np.count_nonzero(rows.chosen) >= SHORTEST:
            yield from (_part_of(column, rows, roles) for column in group if column not in roles)


def _restarts(group: Sequence[Column]) -> bool:
    """Whether a time stands still or goes back, as where one run ends and the next begins."""
    clocks = [column for column in group if column.own.quantity == "time" and column.signal.time is None]
    return any((np.diff(clock.values) <= 0.0).any() for clock in clocks if np.isfinite(clock.values).all())


def _role(column: Column) -> _Role | None:
    """What a column of labels numbers; None for a column of anything else."""
    words = frozenset(tokens(column.label))
    if column.own.joint is not None or column.own.quantity not in {None, "measured"}:
        return None
    if column.own.payload_mass is not None:
        few = np.isfinite(column.values).all() and 1 < len(np.unique(column.values)) <= MOST_PARTS
        return "load" if few else None
    if not is_label(column.values):
        return None
    kinds = set(np.unique(column.values).tolist())
    if words & _JOINT and kinds <= {0.0, 1.0, 2.0, 3.0}:
        return "joint"
    if any(word in CONTROLLER or "控制器" in word for word in words) and kinds <= {1.0, 2.0, 3.0}:
        return "controller"
    return "trial" if words & _TRIAL or any("次" in word for word in words) else None


def _rows(chosen: NDArray[np.bool_], values: Mapping[Column, float], roles: Mapping[Column, _Role]) -> Rows:
    run = [f"{label.label} {value:g}" for label, value in values.items() if roles[label] != "joint"]
    return Rows(chosen, tuple(values.items()), ", ".join(run))


def _part_of(column: Column, rows: Rows, roles: Mapping[Column, _Role]) -> Column:
    """A column as far as it is of one run and joint."""
    told = {roles[label]: value for label, value in rows.labels}
    grams = any(label.signal.unit == "g" for label, _ in rows.labels if roles[label] == "load")
    mass = told["load"] / (1000.0 if grams else 1.0) if "load" in told else None
    names = ", ".join(repr(label.label) for label, _ in rows.labels)
    where = ", ".join(f"{label.label} {value:g}" for label, value in rows.labels)
    return replace(
        column,
        rows=rows,
        joint=int(told["joint"]) if "joint" in told else column.joint,
        assumed=Hints(
            controller=int(told["controller"]) if "controller" in told else None, payload_mass=mass
        ),
        because=[*column.because, f"in the rows of {where}"],
        doubts=[f"a table in long form is cut by its columns {names}"],
    )
