"""Curves in a MATLAB figure, which is a MATLAB file with a tree of graphics objects."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.matlab.values import members, text_of
from tendonrepro.dataset.readers.signals import Found
from tendonrepro.dataset.readers.units import FACTORS, plain_unit

TREES = ("hgS_070000", "hgS_050000")
"""Variables that hold the tree, by the release that wrote it."""
BESIDE = ("hgM_070000", "hgM_050000", "meta_data")
"""Variables that hold the same once more, as objects."""

_DEEPEST = 20
_MOST_CURVES = 1000
_MOST_LINES = 50
_NO_DATA = re.compile(r"legend|colorbar", re.IGNORECASE)
# A round bracket right behind a letter is a function's, as in sin(x).
_UNIT = re.compile(r"(?:\[|(?<!\w)\()\s*([^\[\]()]{1,20}?)\s*[\])]\s*$")
# Places among the list of an axes' special children.
_SPECIAL = {"title": 0, "xlabel": 1, "ylabel": 2}


@dataclass(frozen=True)
class _Node:
    """One graphics object."""

    kind: str
    properties: Mapping[str, Any]
    children: tuple[Any, ...]
    special: tuple[int, ...]


def read_figure(tree: Any, found: Found) -> None:
    """Note the curves of a figure in the value of one of `TREES`."""
    nodes = list(_nodes(tree, 0))
    axes = [
        node
        for node in nodes
        if node.kind == "axes" and not _NO_DATA.search(f"axes {text_of(node.properties.get('Tag'))}")
    ]
    found.text("title", " ".join(text_of(node.properties.get("Name")) for node in nodes[:1]))
    for number, node in enumerate(axes, start=1):
        _axes(f"axes {number}", node, found)
    if not found.signals:
        found.skip("", "a figure without curves")


def _nodes(tree: Any, depth: int) -> Iterator[_Node]:
    """A tree of graphics objects, parents first."""
    if not isinstance(tree, np.ndarray) or tree.dtype.names is None or depth > _DEEPEST:
        return
    for record in tree.ravel():
        own = members(record)
        inner = own.get("children")
        plain = isinstance(inner, np.ndarray) and inner.dtype.names is not None
        yield _Node(
            text_of(own.get("type")),
            members(own.get("properties")),
            tuple(inner.ravel()) if plain else (),  # type: ignore[union-attr]
            tuple(map(int, _numbers(own.get("special")))),
        )
        yield from _nodes(inner, depth + 1)


def _numbers(value: Any) -> NDArray[Any]:
    """Real numbers in a row; none where it is something else."""
    numeric = isinstance(value, np.ndarray) and value.dtype.kind in "iuf"
    return np.ravel(value) if numeric else np.empty(0)


def _lines(value: Any) -> list[str]:
    """Lines of a char array or of a cell array of them."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "OUST":
        lines = [text_of(item) for item in value.ravel()[:_MOST_LINES]]
        return [line for line in lines if line]
    return [text_of(value)] if text_of(value) else []


def _axes(path: str, node: _Node, found: Found) -> None:
    words = _words(node)
    for name, text in words.items():
        found.text(f"{path}/{name}", text)
    curves = list(_curves(node))[:_MOST_CURVES]
    shared = len(curves) > 1 and all(np.array_equal(x, curves[0][1]) for _, x, _ in curves)
    for number, (label, x, y) in enumerate(curves, start=1):
        where = f'{path}/curve {number} "{label}"' if label else f"{path}/curve {number}"
        _add(where, path if shared else where, (label, x, y), words, found)


def _words(node: _Node) -> dict[str, str]:
    """Title and labels of an axes."""
    found = {}
    for name, place in _SPECIAL.items():
        number = node.special[place] if place < len(node.special) else 0
        if 0 < number <= len(node.children):
            text = members(members(node.children[number - 1]).get("properties")).get("String")
            if _lines(text):
                found[name] = " ".join(_lines(text))
    return found


def _curves(node: _Node) -> Iterator[tuple[str, NDArray[Any], NDArray[Any]]]:
    for child in node.children:
        own = members(members(child).get("properties"))
        y, x = _numbers(own.get("YData")), _numbers(own.get("XData"))
        if y.size < 2 or y.size > max(own["YData"].shape):
            continue
        # A curve drawn against its sample numbers may leave them out.
        yield text_of(own.get("DisplayName")), x if x.size == y.size else np.arange(1.0, y.size + 1.0), y


def _add(
    path: str,
    group: str,
    curve: tuple[str, NDArray[Any], NDArray[Any]],
    words: Mapping[str, str],
    found: Found,
) -> None:
    """Note a curve: y at the times x where x is time, else x and y."""
    label, x, y = curve
    x_unit, y_unit = _unit(words.get("xlabel", "")), _unit(words.get("ylabel", ""))
    x = np.asarray(x, np.float64)
    # Without a unit it is taken for seconds.
    factor = FACTORS["time"].get(plain_unit(x_unit or "s") or "")
    if factor is None or not (np.diff(x) > 0.0).all():
        found.add(f"{path}/x", x, label=label, unit=x_unit, group=path)
        found.add(f"{path}/y", y, label=label, unit=y_unit, group=path)
        return
    note = "against x of the figure"
    found.add(f"{path}/y", y, label=label, unit=y_unit, group=group, time=x * factor, note=note)


def _unit(label: str) -> str | None:
    """What stands in brackets at the end of a label."""
    match = _UNIT.search(label)
    return match[1] if match else None
