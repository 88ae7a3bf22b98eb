"""What the files of one command may cost together, however many they are and however small."""

from __future__ import annotations

from dataclasses import dataclass

MOST_NUMBERS = 2**30
"""Bytes of signals in memory: a hundred million numbers, hours of the paper's record."""
MOST_UNPACKED = 2**32
"""Bytes that archives unpack into: a record of some gigabytes is not far-fetched, more is."""
MOST_MEMBERS = 10_000
"""Files in archives: the paper's data needs some dozens; unpacking ten thousand takes a minute."""
MOST_RATIO = 300
"""Unpacked to packed. Logs shrink to a tenth, a constant signal to a three-hundredth."""
RATIO_FROM = 2**26
"""Bytes below which no ratio is suspicious."""


class TooMuch(Exception):
    """An archive unpacks into more than anyone would publish."""


@dataclass
class Allowance:
    """What may still be kept of the files of one command, and unpacked from archives.

    Attributes
    ----------
    numbers : int
        Bytes of signals in memory.
    unpacked : int
        Bytes written to temporary files.
    members : int
        Files in archives.
    size, inside : int
        Bytes of the file at hand, and what it was unpacked into so far, archives within it included.
    """

    numbers: int = MOST_NUMBERS
    unpacked: int = MOST_UNPACKED
    members: int = MOST_MEMBERS
    size: int = MOST_UNPACKED
    inside: int = 0

    def begin(self, size: int) -> None:
        """Go on to a file of so many bytes."""
        self.size, self.inside = size, 0

    def unpack(self, count: int = 0, members: int = 0) -> None:
        """Use some bytes or members up; raises `TooMuch` when there are none left."""
        self.unpacked -= count
        self.members -= members
        self.inside += count
        most = max(RATIO_FROM, MOST_RATIO * self.size)
        message = ""
        if self.inside > most:
            message = f"unpacks into more than {most / 2**20:.0f} MB, too much for {self.size} packed bytes"
        elif self.unpacked < 0:
            message = f"left out after {MOST_UNPACKED / 2**30:.0f} GB unpacked, the most of one command"
        elif self.members < 0:
            message = f"left out after {MOST_MEMBERS} files in archives, the most of one command"
        if message:
            raise TooMuch(message)
