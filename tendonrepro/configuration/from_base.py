"""What a file leaves to its base: values of an arm or an experiment, and units of bare numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import TypeVar

from pydantic import ValidationError

from tendonrepro.arrays import Array
from tendonrepro.configuration import strict_yaml
from tendonrepro.configuration.models.manipulator import Links
from tendonrepro.configuration.overrides import is_quantity
from tendonrepro.configuration.strict_model import describe
from tendonrepro.configuration.strict_yaml import Items, Key, Map, Parsed, Tree
from tendonrepro.errors import ConfigError

MOST_JOINTS = 6
"""Joints of an arm that is completed; its postures and loads are tried up to here."""

USER = "user: given without a source"

Item = TypeVar("Item")


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


@dataclass(frozen=True)
class _Completion:
    """How a file is completed from its base.

    `mark` is the source of what is taken over; with `keeps_sources` only of what changed its length. `size`
    tells how many entries a list at a path has in the file, from that which it has anyway. Sections that are
    `whole` say all of themselves, though their numbers may stand without unit.
    """

    mark: str
    size: Callable[[Key, int], int]
    whole: Callable[[Key, Tree], bool] = lambda *_: False
    keeps_sources: bool = False

    def section(self, own: Map, base: Map, path: Key = ()) -> Map:
        """Keys of the base in its order, then the file's further ones."""
        alone = self.whole(path, own)
        merged = Map((key, self.entry(own, base, (*path, key))) for key in base if key in own or not alone)
        merged.update((key, value) for key, value in own.items() if key not in merged)
        return merged.placed(own.here, {key: base.at[key] for key in merged.keys() & base.at} | own.at)

    def entry(self, own: Map, base: Map, path: Key) -> Parsed:
        """What the file says of the last key of a path, completed, or what the base has."""
        key = str(path[-1])
        if key not in own:
            return self.taken(base[key], path)
        value, of_base = own[key], base[key]
        if isinstance(of_base, Map) and not is_quantity(of_base):
            return self.section(value, of_base, path) if isinstance(value, Map) else value
        if not is_quantity(of_base):
            return value
        if type(value) in (int, float, Items):
            value = Map(value=value).placed(own.at[key], {"value": own.at[key]})
        return self.quantity(value, of_base, path) if isinstance(value, Map) and "value" in value else value

    def quantity(self, stated: Map, base: Map, path: Key) -> Map:
        """A value with unit and source; one that stands alone has the base's unit, one number all entries."""
        value, of_base = stated["value"], base["value"]
        if isinstance(of_base, list) and of_base:
            # Of an arm that is not known, as that of a base, the list itself says how many joints there are.
            n = self.size(path, len(value) if isinstance(value, list) else len(of_base))
            is_matrix = isinstance(of_base[0], list)
            if type(value) in (int, float):
                on_and_above = [[value if q >= p else 0 for q in range(n)] for p in range(n)]
                value = strict_yaml.located(on_and_above if is_matrix else [value] * n, stated.at["value"])
        whole = Map({"value": value, "unit": base["unit"], "source": USER} | stated | {"value": value})
        return whole.placed(stated.here, stated.at)

    def taken(self, base: Parsed, path: Key) -> Parsed:
        """A copy of what the base has, with the file's number of joints."""
        if not isinstance(base, Map):
            return deepcopy(base)
        if not is_quantity(base):
            inner = Map((key, self.taken(value, (*path, key))) for key, value in base.items())
            return inner.placed(base.here, base.at)
        value = base["value"]
        if isinstance(value, list) and value:
            n = self.size(path, len(value))
            resized = extended_matrix(value, n) if isinstance(value[0], list) else extended(value, n)
            value = strict_yaml.located(resized, base.at["value"])
        source = {} if self.keeps_sources and value == base["value"] else {"source": self.mark}
        return Map(base | {"value": value} | source).placed(base.here, base.at)


def complete_arm(arm: Map, base: Map, base_name: str, name: str) -> None:
    """Complete a manipulator from the whole tree of another one, in place; `name` is for one that gives none.

    Bare numbers take the base's units, and one number stands for all joints.
    """
    n = arm.pop("joints", len(base["routing"]["winch_diameter"]["value"]))
    if type(n) is not int or not 1 <= n <= MOST_JOINTS:
        words = f"joints: must be a whole number from 1 to {MOST_JOINTS}, found {describe(n)}"
        raise ConfigError(words, where=str(arm.at["joints"]))
    completion = _Completion(f"assumed: from {base_name}", lambda *_: n)
    arm.setdefault("name", name)
    whole = completion.section(arm, base)
    arm.clear()
    arm.update(whole)
    arm.at = whole.at


def follow(arm: Map, base: Map, base_name: str, given: set[str]) -> None:
    """Let centres of mass and inertias that are not `given` follow lengths and masses that are, in place.

    A centre of mass keeps the base's share of the length, an inertia its share of m l².
    """
    try:
        own, theirs = (Links.model_validate(tree["links"]) for tree in (arm, base))
    except ValidationError:
        return  # the arm will be validated, which says what is wrong
    if not given & {"length", "mass"} or len(own.length.si) != len(own.mass.si):
        return
    followed = {
        "com": ("m", "the length", theirs.com.si / theirs.length.si, own.length.si),
        "inertia": ("kg m2", "m l^2", theirs.inertia.si / _ml2(theirs), _ml2(own)),
    }
    for key in [key for key in followed if key not in given]:
        unit, words, of_base, sizes = followed[key]
        shares = extended(of_base.tolist(), len(sizes))
        value = [float(f"{share * size:.12g}") for share, size in zip(shares, sizes.tolist(), strict=True)]
        told = ", ".join(dict.fromkeys(f"{share:.3g}" for share in shares))
        source = f"assumed: {told} of {words}, as in {base_name}"
        arm["links"][key] = strict_yaml.located({"value": value, "unit": unit, "source": source}, arm.here)


def _ml2(links: Links) -> Array:
    return links.mass.si * links.length.si**2


def complete_experiment(tree: Map, base: Map, base_name: str, taken: set[str]) -> None:
    """Complete an experiment from another one, and give it as many entries as joints move, in place.

    `taken` are the keys that came from the base as they are. Sections are completed, but for those with a
    ``kind``, laws and runs, which are whole.
    """
    moving = len(joints) if isinstance(joints := tree.get("joints"), list) else 0
    winches = strict_yaml.entry(tree, ("manipulator", "routing", "winch_diameter", "value"))
    arm = len(winches) if isinstance(winches, list) else 0

    def size(path: Key, length: int) -> int:
        if path[-1] == "band":
            return length
        return (arm if path[0] == "posture" else moving) or length

    def whole(path: Key, own: Tree) -> bool:
        # What else is left out there has a meaning: no such law, no start offset, joints that move at once.
        return path == ("control", "laws") or path[0] == "runs" or "kind" in own

    mark = f"assumed: from {base_name}, for as many joints as there are here"
    completion = _Completion(mark, size, whole, keeps_sources=True)
    keys = [key for key in base if key in tree and key not in ("manipulator", "joints")]
    like = Map((key, base[key]) for key in keys).placed(base.here, base.at)
    if isinstance(tree.get("runs"), Map) and isinstance(runs := like.get("runs"), Map):
        # A new run is like the base's first one.
        first = next(iter(runs.values()), Map().placed(runs.here, {}))
        like["runs"] = Map((name, runs.get(name, first)) for name in tree["runs"]).placed(runs.here, {})
    for key in keys:
        if key in taken:
            tree[key] = completion.taken(tree[key], (key,))
        else:
            tree[key] = completion.entry(tree, like, (key,))
