"""What a file leaves to its base: values of an arm or an experiment, and units of bare numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from typing import Any, TypeAlias

from tendonrepro.configuration.quantity import UNITS, to_si
from tendonrepro.configuration.strict_model import describe, listed
from tendonrepro.configuration.strict_yaml import Document, Key, Place
from tendonrepro.errors import ConfigError

MOST_JOINTS = 6
"""Joints of an arm that is completed; its postures and loads are tried up to here."""

USER = "user: given without a source"

Sizes: TypeAlias = Callable[[Key, int], int]
"""Number of entries that a list at a path of keys has in the file, from that in the base."""


def _is_number(node: Any) -> bool:
    return type(node) in (int, float)


def _is_quantity(node: Any) -> bool:
    return isinstance(node, dict) and {"value", "unit"} <= node.keys()


def _rank(value: Any) -> int:
    """0 of a number, 1 of a list, 2 of a list of lists."""
    return 1 + _rank(value[0]) if isinstance(value, list) and value else 0


def resized(value: Any, n: int) -> Any:
    """The value of n joints from that of other ones: its first n entries, or the last one repeated.

    Of a matrix, what a further tendon does is what the base's last one does: on the joint where it ends, and
    on those that it passes.
    """
    if not isinstance(value, list):
        return value
    last = len(value) - 1
    if _rank(value) == 1:
        return [value[min(i, last)] for i in range(n)]

    def entry(p: int, q: int) -> Any:
        if p == q:
            return value[min(p, last)][min(p, last)]
        return value[min(p, max(last - 1, 0))][min(q, last)] if p < q else 0

    return [[entry(p, q) for q in range(n)] for p in range(n)]


def _spread(value: Any, rank: int, n: int) -> Any:
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
        size: Sizes,
        whole: Callable[[Key, Mapping[str, Any]], bool],
        mark: str,
        *,
        keeps_sources: bool = False,
    ) -> None:
        self.document, self.size, self.whole, self.mark = document, size, whole, mark
        self.keeps_sources = keeps_sources
        self.wrong: list[tuple[Place, str]] = []

    def section(self, path: Key, own: dict[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
        """Keys of the base in its order, then the file's further ones."""
        alone = bool(path) and self.whole(path, own)
        merged = {}
        for key, held in base.items():
            if key in own:
                merged[key] = self.entry((*path, key), own[key], held)
            elif not alone:
                merged[key] = self.taken((*path, key), held)
        return merged | {key: held for key, held in own.items() if key not in merged}

    def entry(self, path: Key, own: Any, base: Any) -> Any:
        """What the file says, completed."""
        if _is_quantity(base):
            return self.quantity(path, own, base)
        if isinstance(base, dict) and isinstance(own, dict):
            return self.section(path, own, base)
        return own

    def quantity(self, path: Key, own: Any, base: Mapping[str, Any]) -> Any:
        """A value with unit and source; the unit of one that stands alone is the base's."""
        bare = _is_number(own) or isinstance(own, list)
        if not bare and not (isinstance(own, dict) and "value" in own):
            return own
        held = {"value": own} if bare else own
        if bare:
            places = self.document.places
            below = {at: place for at, place in places.items() if at[: len(path)] == path and at != path}
            places |= {(*path, "value", *at[len(path) :]): place for at, place in below.items()}
        rank = _rank(base["value"])
        if rank:
            n = self.size(path, len(base["value"]))
            held = held | {"value": _spread(held["value"], rank, n)}
            self._check(path, held["value"], rank, n)
        return {"value": held["value"], "unit": base["unit"], "source": USER} | held

    def _check(self, path: Key, value: Any, rank: int, n: int) -> None:
        if not isinstance(value, list):
            return
        rows = [row for row in value if isinstance(row, list)] if rank == 2 else []
        found = sorted({len(value), *map(len, rows)})
        if found != [n]:
            many = " and ".join(map(str, found))
            words = f"must have {n} entries, as there are {n} joints, found {many}"
            self.wrong.append((self.document.place(path), f"{'.'.join(map(str, path))}: {words}"))

    def taken(self, path: Key, base: Any) -> Any:
        """A copy of what the base has, with the file's number of joints."""
        if _is_quantity(base):
            rank = _rank(base["value"])
            value = resized(base["value"], self.size(path, len(base["value"]))) if rank else base["value"]
            same = self.keeps_sources and value == base["value"]
            return dict(base) if same else dict(base) | {"value": value, "source": self.mark}
        if isinstance(base, dict):
            return {key: self.taken((*path, key), held) for key, held in base.items()}
        return deepcopy(base)


def complete_arm(arm: Document, base: Mapping[str, Any], base_name: str, name: str) -> None:
    """Complete a manipulator from the whole tree of another one, in place.

    Bare numbers take the base's units, and one number stands for all joints. Centres of mass and inertias
    that the file leaves out follow its lengths and masses. `name` is for an arm that gives none.

    Raises
    ------
    ConfigError
        With a line for every list of a wrong length.
    """
    tree = arm.tree
    n = tree.pop("joints", len(base["routing"]["winch_diameter"]["value"]))
    if type(n) is not int or not 1 <= n <= MOST_JOINTS:
        words = f"joints: must be a whole number from 1 to {MOST_JOINTS}, found {describe(n)}"
        raise ConfigError(words, where=str(arm.place(("joints",))))
    own_links = tree.get("links")
    given = set(own_links) if isinstance(own_links, dict) else set()
    merge = _Merge(arm, lambda *_: n, lambda *_: False, f"assumed: from {base_name}")
    merged = merge.section((), {"name": name, **tree}, base)
    _refuse(merge.wrong)
    if given & {"length", "mass"}:
        merged["links"] |= dict(_following(merged["links"], base["links"], given, base_name))
    tree.clear()
    tree.update(merged)


def complete_experiment(document: Document, base: Mapping[str, Any], base_name: str, taken: set[str]) -> None:
    """Give the parts of an experiment the units and the number of joints that they need, in place.

    `taken` are the keys that came from the base as they are. Sections are completed, but for those with a
    ``kind``, laws and runs.

    Raises
    ------
    ConfigError
        With a line for every list of a wrong length.
    """
    tree = document.tree
    moving = len(joints) if isinstance(joints := tree.get("joints"), list) and joints else None
    arm = len(held) if (held := _winches(tree)) else None
    base_runs = base.get("runs", {})
    first_run = next(iter(base_runs.values())) if isinstance(base_runs, dict) and base_runs else {}

    def size(path: Key, length: int) -> int:
        if path[-1] == "band":
            return length
        return (arm if path[0] == "posture" else moving) or length

    def whole(path: Key, own: Mapping[str, Any]) -> bool:
        # What else is left out there has a meaning: no such law, no start offset, joints that move at once.
        return path == ("control", "laws") or path[0] == "runs" or "kind" in own

    mark = f"assumed: from {base_name}, for as many joints as there are here"
    merge = _Merge(document, size, whole, mark, keeps_sources=True)
    for key in [key for key in tree if key in base and key not in ("manipulator", "joints")]:
        if key in taken:
            tree[key] = merge.taken((key,), tree[key])
        elif key == "runs" and isinstance(tree[key], dict):
            # A new run is like the base's first one.
            model = {name: base_runs.get(name, first_run) for name in tree[key]}
            tree[key] = merge.section((key,), tree[key], model)
        else:
            tree[key] = merge.entry((key,), tree[key], base[key])
    _refuse(merge.wrong)


def _winches(tree: Mapping[str, Any]) -> list[Any] | None:
    """Winch diameters of the arm, as far as they are well-formed."""
    found = _at(tree, ("manipulator", "routing", "winch_diameter", "value"))
    return found if isinstance(found, list) else None


def _at(tree: Any, path: Key) -> Any:
    for key in path:
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree


def _following(
    links: Mapping[str, Any], base: Mapping[str, Any], given: set[str], base_name: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Centres of mass as the base's share of the length, inertias as its share of m l²."""
    own, theirs = _in_si(links, ("length", "mass")), _in_si(base, ("length", "mass", "com", "inertia"))
    if own is None or theirs is None:
        return  # validation says what is wrong
    n = len(own["length"])
    length, mass, com, inertia = (resized(theirs[key], n) for key in ("length", "mass", "com", "inertia"))
    rows = range(n)
    if "com" not in given:
        share = [com[i] / length[i] for i in rows]
        value = [_short(share[i] * own["length"][i]) for i in rows]
        yield "com", _derived(value, "m", f"{_share(share)} of the length, as in {base_name}")
    if "inertia" not in given:
        share = [inertia[i] / (mass[i] * length[i] ** 2) for i in rows]
        value = [_short(share[i] * own["mass"][i] * own["length"][i] ** 2) for i in rows]
        yield "inertia", _derived(value, "kg m2", f"{_share(share)} of m l^2, as in {base_name}")


def _in_si(links: Mapping[str, Any], keys: tuple[str, ...]) -> dict[str, list[float]] | None:
    """Lists of some keys in SI units; None unless all are of positive numbers."""
    found = {}
    for key in keys:
        held = links[key]
        if not _is_quantity(held) or held["unit"] not in UNITS or not isinstance(held["value"], list):
            return None
        if not all(_is_number(value) and value > 0.0 for value in held["value"]):
            return None
        found[key] = [to_si(value, held["unit"]) for value in held["value"]]
    return found


def _short(value: float) -> float:
    """Without the digits that rounding leaves."""
    return float(f"{value:.12g}")


def _share(shares: list[float]) -> str:
    found = dict.fromkeys(f"{share:.3g}" for share in shares)
    return ", ".join(found)


def _derived(value: list[float], unit: str, words: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "source": f"assumed: {words}"}


def _refuse(wrong: list[tuple[Place, str]]) -> None:
    if wrong:
        raise listed(wrong)
