"""Vectors and matrices have as many entries as the arm has joints, or as move."""

from __future__ import annotations

from collections.abc import Mapping

from tendonrepro.configuration.fields.model import Mistakes, Model
from tendonrepro.configuration.fields.quantity import PER_ENTRY, Matrix, Quantity, Size


def wrong_sizes(part: object, sizes: Mapping[Size, int]) -> Mistakes:
    """Mistakes of all vectors and matrices in a model or dict; `sizes` holds what is known."""
    if isinstance(part, Quantity) and part.size in sizes:
        lengths = {len(part.value), *map(len, part.value if isinstance(part, Matrix) else ())}
        if lengths != {sizes[part.size]}:
            found = " and ".join(map(str, sorted(lengths)))
            yield ("value",), f"must have {sizes[part.size]} entries, {PER_ENTRY[part.size]}, found {found}"
    elif isinstance(part, Model | dict) and not isinstance(part, Quantity):
        for name, item in part.items() if isinstance(part, dict) else part:
            for place, words in wrong_sizes(item, sizes):
                yield (name, *place), words
