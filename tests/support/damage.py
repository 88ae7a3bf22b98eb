"""Stored files, damaged: by chance with a seed, and JSON of another shape."""

import json
import random

EXTREME = [0, 1, 0x7F, 0x80, 0xFF]


def by_chance(content: bytes, seed: object) -> bytes:
    """Bits flipped, numbers made extreme, a piece copied over a place, or the end cut off; never the same."""
    dice = random.Random(str(seed))
    data = bytearray(content)
    while data == content:
        place, size = dice.randrange(len(data)), dice.choice([1, 2, 4, 8])
        kind = dice.randrange(4)
        if kind == 0:
            data[place] ^= 1 << dice.randrange(8)
        elif kind == 1:
            data[place : place + size] = bytes([dice.choice(EXTREME)] * size)
        elif kind == 2:
            start = dice.randrange(len(data))
            data[place : place + 40] = data[start : start + 40]
        else:
            del data[place:]
    return bytes(data)


def of_another_shape(content: bytes) -> list[bytes]:
    """JSON that is none, or holds something else anywhere in its first two levels."""
    tree = json.loads(content)
    others = [b"", b"\xff\xfe", b"[" * 100_000, b"NaN", b"9" * 5000, b"null", b"[]", b"{}", b'"text"']
    wrong = [None, 3, 1e308, float("nan"), "text", [], {}, [[]], {"a": 1}]
    for key, value in tree.items():
        others.append(json.dumps({name: one for name, one in tree.items() if name != key}).encode())
        others += [json.dumps(tree | {key: other}).encode() for other in wrong if other != value]
        if isinstance(value, list):
            others += [json.dumps(tree | {key: [other, *value[1:]]}).encode() for other in wrong]
    return others
