"""How much of one file is taken in, so that no file can exhaust memory or patience."""

from __future__ import annotations

from tendonrepro.dataset.readers.signals import Found

BEST_PACKING = 1032
"""Bytes that one compressed byte can stand for at most; deflate packs no better."""
HARMLESS = 2**24
"""Bytes that a file may announce whatever it holds."""
MOST_SIGNALS = 5000
"""A record of every state of the arm has some hundred signals; more is a file of another kind."""


def is_full(found: Found) -> bool:
    """Whether no more signals shall be added."""
    return len(found.signals) >= MOST_SIGNALS


def note_rest(found: Found, count: int, what: str) -> None:
    """Note how many things were left out because there are too many."""
    if count > 0:
        found.skip("", f"{count} more {what} left out after {MOST_SIGNALS} signals", "split the file")
