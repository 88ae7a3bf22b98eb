"""The one family of errors a user can meet, each with its exit code; and the word that was probably meant."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import ClassVar


class TendonreproError(Exception):
    """A failure that is explained in one message, never shown as a traceback.

    Parameters
    ----------
    message : str
    where : str, optional
        Place of the mistake, ``file:line`` where there is one.
    hint : str, optional
        How to mend it.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, *, where: str | None = None, hint: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.hint = hint

    def __str__(self) -> str:
        """Place, message and way out, on one line each."""
        head = f"{self.where}: {self.message}" if self.where else self.message
        return f"{head}\n{self.hint}" if self.hint else head


class ConfigError(TendonreproError):
    """The configuration cannot be used."""

    exit_code: ClassVar[int] = 2


class UsageError(TendonreproError):
    """The command cannot be carried out as it was given."""

    exit_code: ClassVar[int] = 2


class DataMissingError(TendonreproError):
    """Something that should be on disk is missing or cannot be read."""

    exit_code: ClassVar[int] = 4


class NoSuchKeyError(UsageError, KeyError):
    """A result has nothing of that name."""


def nearest(word: str, words: Iterable[str]) -> str | None:
    """The word that was probably meant, if any is near."""
    lower = {candidate.lower(): candidate for candidate in words}
    close = get_close_matches(word.lower(), lower, n=1)
    return lower[close[0]] if close else None


def did_you_mean(word: object, words: Iterable[str]) -> str:
    """Question after the word that was probably meant, or nothing."""
    meant = nearest(str(word), words)
    return "" if meant is None else f", did you mean {meant!r}?"


def no_such(kind: str, name: object, names: Iterable[str]) -> NoSuchKeyError:
    """Error of a wrong key, with the right one, and all that there are."""
    known = list(names)
    message = f"there is no {kind} {name!r}{did_you_mean(name, known)}"
    return NoSuchKeyError(message, hint=f"There are: {', '.join(known) or 'none'}")
