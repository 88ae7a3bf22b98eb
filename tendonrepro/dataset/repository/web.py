"""Requests to the repository: own name, patience with limits, and each failure in one sentence."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tendonrepro import __version__
from tendonrepro.console import Talk
from tendonrepro.dataset.repository.headers import kind_of_body, md5_of_body, place_of_body, seconds_asked
from tendonrepro.dataset.repository.web_errors import (
    BY_HAND,
    TOO_MANY,
    WebError,
    host_of,
    passing,
    refused,
    unreached,
)
from tendonrepro.dataset.repository.zenodo import plain

if TYPE_CHECKING:
    from requests import Response, Session

PROJECT = "https://doi.org/10.3390/act15050271"
AGENT = f"tendonrepro/{__version__} (+{PROJECT}; reproduction of a published experiment)"
LARGEST_JSON = 64 * 2**20
CHUNK = 2**14
"""Bytes of a body taken at once; those of an unfinished one are lost when the connection ends."""


@dataclass(frozen=True)
class Patience:
    """How often to try, and how long to wait.

    Attributes
    ----------
    tries : int
        Most requests for one answer.
    backoff : float
        s, before the second try; doubled before each further one.
    longest : float
        s, most that a server may ask to wait in all.
    timeout : tuple of float
        s, for a connection and for the next byte.
    sleep : callable
        Waits so many seconds.
    """

    tries: int = 4
    backoff: float = 0.25
    longest: float = 180.0
    timeout: tuple[float, float] = (15.0, 60.0)
    sleep: Callable[[float], None] = time.sleep


class CutShortError(Exception):
    """A body that ended early; asking for the rest is worth it."""


@dataclass(frozen=True)
class Body:
    """A file on its way.

    Attributes
    ----------
    status : int
        200 for all of it, 206 for a part, 416 if there is no such part.
    start, total : int or None
        First byte of what comes, and size of the whole file, where the server says so.
    md5 : str or None
        As the server announces it.
    chunks : iterator of bytes
        Raises :class:`CutShortError` when the connection ends.
    """

    status: int
    start: int | None
    total: int | None
    md5: str | None
    chunks: Iterator[bytes]


class Web:
    """Asks one repository; proxies come from the environment.

    Parameters
    ----------
    talk : Talk
        Told about every wait.
    patience : Patience
    """

    def __init__(self, talk: Talk, patience: Patience) -> None:
        self.talk = talk
        self.patience = patience

    @cached_property
    def _session(self) -> Session:
        from requests import Session

        session = Session()
        session.headers["User-Agent"] = AGENT
        session.max_redirects = 5
        return session

    def json(self, url: str, what: str) -> object:
        """Get an answer in JSON.

        Parameters
        ----------
        url : str
        what : str
            Name of the thing asked for, for messages.

        Returns
        -------
        object

        Raises
        ------
        WebError
            If it does not come.
        """
        with self._answer(url, what, {"Accept": "application/json"}) as response:
            if "json" not in (kind := kind_of_body(response.headers)):
                message = f"{what}: {host_of(url)} sent {kind or 'something'} instead of JSON"
                hint = f"look at {url} in a browser: a proxy or a login page may be in the way, {BY_HAND}"
                raise WebError(message, hint=hint, status=response.status_code)
            try:
                return json.loads(_whole(response))
            except (ValueError, RecursionError, CutShortError) as error:
                message = f"{what}: the JSON that {host_of(url)} sent is damaged"
                raise WebError(message, hint=f"try again, {BY_HAND}", status=response.status_code) from error

    @contextmanager
    def body(self, url: str, what: str, start: int = 0, *, page: bool = False) -> Iterator[Body]:
        """Get a file, or the rest of it.

        Parameters
        ----------
        url : str
        what : str
            Name of the file, for messages.
        start : int
            First byte wanted. The server may send the whole file nevertheless.
        page : bool
            Whether the file is a web page; else one that comes is taken for a message to people.

        Yields
        ------
        Body

        Raises
        ------
        WebError
            If it does not come.
        """
        # A compressed body would make its length and its ranges those of something else.
        headers = {"Accept": "*/*", "Accept-Encoding": "identity"}
        if start:
            headers["Range"] = f"bytes={start}-"
        with self._answer(url, what, headers) as response:
            if kind_of_body(response.headers) == "text/html" and not page and response.status_code != 416:
                message = f"{what}: {host_of(url)} sent a web page instead of the file"
                hint = f"a proxy or a login page may be in the way; try again later, {BY_HAND}"
                raise WebError(message, hint=hint, status=response.status_code)
            first, total = place_of_body(response.status_code, response.headers)
            yield Body(response.status_code, first, total, md5_of_body(response.headers), _chunks(response))

    @contextmanager
    def _answer(self, url: str, what: str, headers: dict[str, str]) -> Iterator[Response]:
        """Ask until there is an answer that more asking would not change."""
        from requests.exceptions import RequestException

        waited = 0.0
        for attempt in range(1, self.patience.tries + 1):
            last = attempt == self.patience.tries
            pause = self.patience.backoff * 2 ** (attempt - 1)
            try:
                response = self._session.get(url, headers=headers, timeout=self.patience.timeout, stream=True)
            except (RequestException, ValueError) as error:  # a ValueError where a name makes no sense
                if last or not passing(error):
                    raise unreached(error, url, what) from error
                self.patience.sleep(pause)
                continue
            with response:
                if response.status_code == TOO_MANY and not last:
                    pause = seconds_asked(response.headers, pause)
                    if waited + pause <= self.patience.longest:
                        self.talk.note(f"{host_of(url)} has had too many requests: waiting {pause:.0f} s")
                        self.patience.sleep(pause)
                        waited += pause
                        continue
                if response.status_code >= 500 and not last:
                    self.talk.detail(f"{host_of(url)} answers {response.status_code}: trying again")
                    self.patience.sleep(pause)
                    continue
                if response.status_code not in {200, 206, 416}:
                    raise refused(
                        response.status_code,
                        response.url,
                        kind_of_body(response.headers),
                        _said(response),
                        what,
                    )
                yield response
                return


def _said(response: Response) -> str:
    """What a refusal says in its JSON, with the note on a deleted record."""
    if "json" not in kind_of_body(response.headers):
        return ""
    try:
        data = json.loads(_whole(response))
    except (ValueError, RecursionError, CutShortError):
        return ""
    tree: dict[str, Any] = data if isinstance(data, dict) else {}
    stone = tree.get("tombstone")
    stone = stone if isinstance(stone, dict) else {}
    reason = stone.get("removal_reason")
    reason = reason.get("id") if isinstance(reason, dict) else reason
    words = [tree.get("message"), stone.get("note"), reason]
    return "; ".join(plain(word).rstrip(".") for word in words if isinstance(word, str) and word.strip())


def _whole(response: Response) -> bytearray:
    content = bytearray()
    for chunk in _chunks(response):
        content += chunk
        if len(content) > LARGEST_JSON:
            message = "more than any record needs"
            raise CutShortError(message)
    return content


def _chunks(response: Response) -> Iterator[bytes]:
    from requests.exceptions import RequestException

    try:
        yield from response.iter_content(CHUNK)
    except RequestException as error:
        raise CutShortError(str(error)) from error
