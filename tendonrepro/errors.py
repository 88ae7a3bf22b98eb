"""The one family of errors a user can meet, each with its exit code."""

from __future__ import annotations

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
