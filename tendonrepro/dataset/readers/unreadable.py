"""The one way in which a reader gives up on a file."""

from __future__ import annotations


class Unreadable(Exception):
    """A file that cannot be read as a whole; reported beside the files that can.

    Parameters
    ----------
    reason : str
        Why, in a few words.
    advice : str
        What a user can do about it.
    """

    def __init__(self, reason: str, advice: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.advice = advice
