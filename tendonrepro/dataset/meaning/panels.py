"""What the paper's figures show, for columns of files that are called after one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from tendonrepro.dataset.meaning.columns import Column
from tendonrepro.dataset.meaning.evidence import counted_in
from tendonrepro.dataset.meaning.words import Hints, Quantity

PANELS: Mapping[int, Mapping[str | None, tuple[Quantity | None, int | None]]] = {
    9: {None: ("motor", None)},
    10: {None: (None, 1)},
    11: {None: (None, 2)},
    12: {None: (None, 3)},
    14: {"a": ("measured", 2), "b": ("measured", 3), "c": ("error", 2), "d": ("error", 3)},
    15: {
        "a": ("surface", 2), "b": ("surface", 3), "c": ("estimate", 2), "d": ("estimate", 3),
        "e": ("torque", 2), "f": ("torque", 3),
    },
    16: {"a": ("measured", 2), "b": ("measured", 3)},
}  # fmt: skip
"""Quantity and joint, panel by panel; None stands for a figure without panels."""
ORDER: Mapping[int, Sequence[Hints]] = {
    14: [Hints(controller=number) for number in (1, 2, 3)],
    15: [Hints(controller=number) for number in (1, 2, 3)],
    16: [Hints(controller=1, payload_mass=0.0), Hints(controller=1, payload_mass=float("nan"))],
}
"""Runs whose curves a figure shows, as its legend names them."""
_ANGLES_OR_ERRORS = "the curves of Figure 16 are taken for angles; if they are errors, `variable: e`"


def find_panels(columns: Iterable[Column]) -> None:
    """Fill in what the paper's figures show where files name figure and panel; times are known."""
    panels: dict[tuple[object, ...], list[Column]] = defaultdict(list)
    for column in columns:
        if column.figure is not None and column.quantity not in {"time", "index"}:
            panels[column.figure, *column.group[:2]].append(column)
    for curves in panels.values():
        figure, panel = curves[0].figure or (0, None)
        quantity, joint = PANELS.get(figure, {}).get(panel, (None, None))
        _name(curves, figure, f"Figure {figure}{panel or ''} shows it", quantity, joint)
        for column in curves:
            if column.joint is None and joint is not None:
                column.joint = joint
                column.because.append(f"Figure {figure}{panel or ''} is of joint {joint}")
        _order(curves, figure)


def _name(
    curves: Sequence[Column], figure: int, shown: str, quantity: Quantity | None, joint: int | None
) -> None:
    """Quantities of the curves of one panel."""
    unnamed = [column for column in curves if column.quantity is None]
    stepped = [column for column in unnamed if counted_in(column.values)]
    if quantity is None and joint and len(unnamed) == 2 and len(stepped) == 1:
        for column in unnamed:
            told: Quantity = "measured" if column in stepped else "calculated"
            column.call(told, f"{shown}, and of two curves the measured one has an encoder's steps")
    elif quantity is not None:
        for column in unnamed:
            if quantity == "measured" and column not in stepped and len(stepped) == len(unnamed) - 1 > 0:
                column.call("desired", f"{shown}, and it alone has no encoder's steps")
            else:
                column.call(quantity, shown)
            column.doubts += [_ANGLES_OR_ERRORS] if figure == 16 else []


def _order(curves: Sequence[Column], figure: int) -> None:
    """Runs of the curves of one panel by their order, where no name tells any of them."""
    runs = ORDER.get(figure, ())
    followers = [column for column in curves if column.quantity not in {None, "desired"}]
    told = any(column.controller or column.payload_mass is not None for column in curves)
    if told or len(followers) != len(runs) or len({column.quantity for column in followers}) > 1:
        return
    for column, run in zip(followers, runs, strict=True):
        column.assumed = run
        column.doubts.append(
            f"the curves of Figure {figure} have no names, so they are taken in the paper's order"
        )
