"""What a file leaves to its base: values of an arm or an experiment, and units of bare numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from typing import TypeAlias, TypeGuard, TypeVar

from tendonrepro.configuration.quantity import UNITS, to_si
from tendonrepro.configuration.strict_model import describe, listed
from tendonrepro.configuration.strict_yaml import Document, Key, Location, Node, Tree, section
from tendonrepro.errors import ConfigError

MOST_JOINTS = 6
"""Joints of an arm that is completed; its postures and loads are tried up to here."""

USER = "user: given without a source"

Item = TypeVar("Item")

LengthOf: TypeAlias = Callable[[Key, int], int]
"""Number of entries that a list at a path of keys has in the file, from that in the base."""


def _is_number(node: object) -> TypeGuard[float]:
    return type(node) in (int, float)


def _is_quantity(node: object) -> TypeGuard[Tree]:
    return isinstance(node, dict) and {"value", "unit"} <= node.keys()


def _rank(value: Node) -> int:
    """0 of a number, 1 of a list, 2 of a list of lists."""
    return 1 + _rank(value[0]) if isinstance(value, list) and value else 0


def extended(values: Sequence[Item], n: int) -> list[Item]:
    """Entries of n joints from those of other ones: the first n, or the last one repeated."""
    return [values[min(i, len(values) - 1)] for i in range(n)]


def extended_matrix(rows: Sequence[Sequence[Item]], n: int) -> list[list[Item | int]]:
    """Rows of n joints from those of other ones.

    What a further tendon does is what the base's last one does: on the joint where it ends, and on those that
    it passes.
    """
    last = len(rows) - 1

    def entry(p: int, q: int) -> Item | int:
        if p == q:
            return rows[min(p, last)][min(p, last)]
        return rows[min(p, max(last - 1, 0))][min(q, last)] if p < q else 0

    return [[entry(p, q) for q in range(n)] for p in range(n)]


def _resized(value: Node, n: int) -> Node:
    """The value of n joints from that of other ones, whatever its rank."""
    if not isinstance(value, list):
        return value
    if _rank(value) == 1:
        return extended(value, n)
    return [*extended_matrix([row for row in value if isinstance(row, list)], n)]


def _spread(value: Node, rank: int, n: int) -> Node:
    """A number as n of it; of a matrix, on and above the diagonal."""
    if not _is_number(value) or rank == 0:
        return value
    if rank == 1:
        return [value] * n
    return [[value if q >= p else 0 for q in range(n)] for p in range(n)]


class _Merge:
    """Merges one document with its base, in place.

    `whole` tells sections that a file states alone, though their numbers may stand without unit. `mark` is
    the source of what is taken over; with `keeps_sources` only of what changed its length.
    """

    def __init__(
        self,
        document: Document,
        size: LengthOf,
        whole: Callable[[Key, Tree], bool],
        mark: str,
        *,
        keeps_sources: bool = False,
    ) -> None:
        self.document, self.size, self.whole, self.mark = document, size, whole, mark
        self.keeps_sources = keeps_sources
        self.wrong: list[tuple[Location, str]] = []

    def section(self, path: Key, own: Tree, base: Tree) -> Tree:
        """Keys of the base in its order, then the file's further ones."""
        alone = bool(path) and self.whole(path, own)
        merged: Tree = {}
        for key, of_base in base.items():
            if key in own:
                merged[key] = self.entry((*path, key), own[key], of_base)
            elif not alone:
                merged[key] = self.taken((*path, key), of_base)
        return merged | {key: value for key, value in own.items() if key not in merged}

    def entry(self, path: Key, own: Node, base: Node) -> Node:
        """What the file says, completed."""
        if _is_quantity(base):
            return self.quantity(path, own, base)
        if isinstance(base, dict) and isinstance(own, dict):
            return self.section(path, own, base)
        return own

    def quantity(self, path: Key, own: Node, base: Tree) -> Node:
        """A value with unit and source; the unit of one that stands alone is the base's."""
        stated: Tree
        if _is_number(own) or isinstance(own, list):
            stated = {"value": own}
            places = self.document.places
            below = {at: place for at, place in places.items() if at[: len(path)] == path and at != path}
            places |= {(*path, "value", *at[len(path) :]): place for at, place in below.items()}
        elif isinstance(own, dict) and "value" in own:
            stated = own
        else:
            return own
        value, of_base = stated["value"], base["value"]
        if isinstance(of_base, list) and (rank := _rank(of_base)):
            n = self.size(path, len(of_base))
            value = _spread(value, rank, n)
            self._check(path, value, rank, n)
        return {"value": value, "unit": base["unit"], "source": USER} | stated | {"value": value}

    def _check(self, path: Key, value: Node, rank: int, n: int) -> None:
        if not isinstance(value, list):
            return
        rows = [row for row in value if isinstance(row, list)] if rank == 2 else []
        lengths = sorted({len(value), *map(len, rows)})
        if lengths != [n]:
            many = " and ".join(map(str, lengths))
            words = f"must have {n} entries, as there are {n} joints, found {many}"
            self.wrong.append((self.document.place(path), f"{'.'.join(map(str, path))}: {words}"))

    def taken(self, path: Key, base: Node) -> Node:
        """A copy of what the base has, with the file's number of joints."""
        if _is_quantity(base):
            value = base["value"]
            if isinstance(value, list) and value:
                value = _resized(value, self.size(path, len(value)))
            same = self.keeps_sources and value == base["value"]
            return dict(base) if same else dict(base) | {"value": value, "source": self.mark}
        if isinstance(base, dict):
            return {key: self.taken((*path, key), value) for key, value in base.items()}
        return deepcopy(base)


def complete_arm(arm: Document, base: Tree, base_name: str, name: str) -> set[str]:
    """Complete a manipulator from the whole tree of another one, in place.

    Bare numbers take the base's units, and one number stands for all joints. Centres of mass and inertias
    that the file leaves out follow its lengths and masses. `name` is for an arm that gives none.

    Returns
    -------
    set of str
        What the file says of its links.

    Raises
    ------
    ConfigError
        With a line for every list of a wrong length.
    """
    tree = arm.tree
    winches = _winches(base)
    assert winches
    n = tree.pop("joints", len(winches))
    if type(n) is not int or not 1 <= n <= MOST_JOINTS:
        words = f"joints: must be a whole number from 1 to {MOST_JOINTS}, found {describe(n)}"
        raise ConfigError(words, where=str(arm.place(("joints",))))
    own_links = tree.get("links")
    given = set(own_links) if isinstance(own_links, dict) else set()
    merge = _Merge(arm, lambda *_: n, lambda *_: False, f"assumed: from {base_name}")
    merged = merge.section((), {"name": name, **tree}, base)
    _refuse(merge.wrong)
    tree.clear()
    tree.update(merged)
    if given & {"length", "mass"}:
        follow(tree, base, base_name, given)
    return given


def follow(arm: Tree, base: Tree, base_name: str, given: set[str]) -> None:
    """Let centres of mass and inertias that are not given follow lengths and masses, in place."""
    links = section(arm, "links")
    links |= dict(_following(links, section(base, "links"), given, base_name))


def complete_experiment(document: Document, base: Tree, base_name: str, taken: set[str]) -> None:
    """Give the parts of an experiment the units and the number of joints that they need, in place.

    `taken` are the keys that came from the base as they are. Sections are completed, but for those with a
    ``kind``, laws and runs.

    Raises
    ------
    ConfigError
        With a line for every list of a wrong length.
    """
    tree: Tree = document.tree
    moving = len(joints) if isinstance(joints := tree.get("joints"), list) and joints else None
    arm = len(winches) if (winches := _winches(tree.get("manipulator"))) else None
    base_runs = runs if isinstance(runs := base.get("runs"), dict) else {}
    first_run = next(iter(base_runs.values()), {})

    def size(path: Key, length: int) -> int:
        if path[-1] == "band":
            return length
        return (arm if path[0] == "posture" else moving) or length

    def whole(path: Key, own: Tree) -> bool:
        # What else is left out there has a meaning: no such law, no start offset, joints that move at once.
        return path == ("control", "laws") or path[0] == "runs" or "kind" in own

    mark = f"assumed: from {base_name}, for as many joints as there are here"
    merge = _Merge(document, size, whole, mark, keeps_sources=True)
    for key in [key for key in tree if key in base and key not in ("manipulator", "joints")]:
        if key in taken:
            tree[key] = merge.taken((key,), tree[key])
        elif key == "runs" and isinstance(runs := tree[key], dict):
            # A new run is like the base's first one.
            model = {name: base_runs.get(name, first_run) for name in runs}
            tree[key] = merge.section((key,), runs, model)
        else:
            tree[key] = merge.entry((key,), tree[key], base[key])
    _refuse(merge.wrong)


def _winches(arm: Node) -> list[Node] | None:
    """Winch diameters of an arm, as far as they are well-formed."""
    node = arm
    for key in ("routing", "winch_diameter", "value"):
        node = node.get(key) if isinstance(node, dict) else None
    return node if isinstance(node, list) else None


def _following(links: Tree, base: Tree, given: set[str], base_name: str) -> Iterator[tuple[str, Tree]]:
    """Centres of mass as the base's share of the length, inertias as its share of m l²."""
    own, theirs = _in_si(links, ("length", "mass")), _in_si(base, ("length", "mass", "com", "inertia"))
    if own is None or theirs is None:
        return  # validation says what is wrong
    n = len(own["length"])
    length, mass, com, inertia = (extended(theirs[key], n) for key in ("length", "mass", "com", "inertia"))
    rows = range(n)
    if "com" not in given:
        share = [com[i] / length[i] for i in rows]
        value = [_short(share[i] * own["length"][i]) for i in rows]
        yield "com", _derived(value, "m", f"{_share(share)} of the length, as in {base_name}")
    if "inertia" not in given:
        share = [inertia[i] / (mass[i] * length[i] ** 2) for i in rows]
        value = [_short(share[i] * own["mass"][i] * own["length"][i] ** 2) for i in rows]
        yield "inertia", _derived(value, "kg m2", f"{_share(share)} of m l^2, as in {base_name}")


def _in_si(links: Tree, keys: tuple[str, ...]) -> dict[str, list[float]] | None:
    """Lists of some keys in SI units; None unless all are of positive numbers."""
    in_si = {}
    for key in keys:
        quantity = links[key]
        if not _is_quantity(quantity):
            return None
        unit, values = quantity["unit"], quantity["value"]
        if unit not in UNITS or not isinstance(values, list):
            return None
        numbers = [value for value in values if _is_number(value) and value > 0.0]
        if len(numbers) < len(values):
            return None
        in_si[key] = [to_si(value, unit) for value in numbers]
    return in_si


def _short(value: float) -> float:
    """Without the digits that rounding leaves."""
    return float(f"{value:.12g}")


def _share(shares: list[float]) -> str:
    return ", ".join(dict.fromkeys(f"{share:.3g}" for share in shares))


def _derived(value: Sequence[float], unit: str, words: str) -> Tree:
    return {"value": [*value], "unit": unit, "source": f"assumed: {words}"}


def _refuse(wrong: list[tuple[Location, str]]) -> None:
    if wrong:
        raise listed(wrong)
