"""A configuration for an arm with fewer joints: entries are taken out of the text, comments stay."""

from __future__ import annotations

from collections.abc import Iterator

import yaml

from tendonrepro.errors import UsageError

Sizes = dict[int, int]
"""New length of a list, by its length."""

ARM = 3
"""Joints of the shipped arm; the first ones are kept."""


def with_joints(text: str, joints: int) -> str:
    """Shorten every vector and matrix that has an entry per joint, or per moving joint.

    As many joints move as did, at most all; they are the last ones, as always.
    """
    if not 1 <= joints <= ARM:
        raise UsageError(f"the shipped arm has {ARM} joints, {joints} cannot be kept", where="--joints")
    root = yaml.compose(text, Loader=yaml.BaseLoader)
    assert isinstance(root, yaml.MappingNode)
    keys = {key.value: item for key, item in root.value}
    # A file without the key has the comparison as its base, where two joints move.
    named = len(keys["joints"].value) if "joints" in keys else 2
    moving = list(range(joints + 1 - min(named, joints), joints + 1))
    cuts = _cuts(root, "", {ARM: joints, named: len(moving)}, moving)
    for start, end, new in sorted(cuts, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _cuts(node: yaml.Node, key: str, sizes: Sizes, moving: list[int]) -> Iterator[tuple[int, int, str]]:
    """Start and end of pieces of the text, and what replaces each; the node stands under a key."""
    if isinstance(node, yaml.MappingNode):
        for name, item in node.value:
            yield from _cuts(item, name.value, sizes, moving)
    elif key == "joints":
        yield node.start_mark.index, node.end_mark.index, str(moving)
    elif key == "turns":
        turns = [[int(joint.value) for joint in turn.value] for turn in node.value]
        left = [[joint for joint in turn if joint in moving] for turn in turns]
        yield node.start_mark.index, node.end_mark.index, str([turn for turn in left if turn])
    elif key == "value" and isinstance(node, yaml.SequenceNode):
        kept = node.value[: sizes.get(len(node.value))]
        yield kept[-1].end_mark.index, node.value[-1].end_mark.index, ""
        for row in kept:
            yield from _cuts(row, key, sizes, moving)
