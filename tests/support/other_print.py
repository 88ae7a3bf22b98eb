"""The paper with other numbers."""

from dataclasses import replace
from types import MappingProxyType

from tendonrepro.configuration.published import PrintedNumber


def with_numbers(paper, values, decimals=None):
    """The print with other values, by id; with as many decimals as printed if none are given."""
    entries = dict(paper.entries)
    for name, value in values.items():
        entry = entries[name]
        assert isinstance(entry, PrintedNumber)
        digits = entry.decimals if decimals is None else decimals
        entries[name] = entry.model_copy(update={"value": round(float(value), digits), "decimals": digits})
    return replace(paper, entries=MappingProxyType(entries))
