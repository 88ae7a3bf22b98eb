"""Vectors and matrices have as many entries as the arm has joints, or as move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache

from tendonrepro.configuration.fields.model import Model
from tendonrepro.configuration.fields.quantity import PER_ENTRY, Matrix, Quantity, Size, rule_of
from tendonrepro.configuration.fields.strict_yaml import Key


def wrong_sizes(part: object, sizes: Mapping[Size, int], size: Size = "one") -> Iterator[tuple[Key, str]]:
    """Mistakes of all vectors and matrices in a part of a configuration, each with its place.

    Parameters
    ----------
    part : Model or dict
    sizes : mapping of str to int
        Number of joints, and of moving joints, where they are known.
    size : str
        What `part` itself should have, if it is a vector or matrix.
    """
    if isinstance(part, Quantity):
        rows = part.value if isinstance(part, Matrix) else ()
        lengths = {len(part.value), *map(len, rows)} if size in sizes else set()
        if lengths - {sizes.get(size)}:
            found = " and ".join(map(str, sorted(lengths)))
            yield ("value",), f"must have {sizes[size]} entries, {PER_ENTRY[size]}, found {found}"
    elif isinstance(part, Model | dict):
        wanted = {} if isinstance(part, dict) else _sizes_of(type(part))
        for name, item in part.items() if isinstance(part, dict) else part:
            for place, words in wrong_sizes(item, sizes, wanted.get(name, "one")):
                yield (name, *place), words


@cache
def _sizes_of(model: type[Model]) -> Mapping[str, Size]:
    """What each field of a model should have."""
    rules = {name: rule_of(field) for name, field in model.model_fields.items()}
    return {name: rule.size for name, rule in rules.items() if rule}
