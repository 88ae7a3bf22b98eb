"""Requests to the repository: own name, patience with limits, and answers as far as they can be believed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from http.client import HTTPException
from threading import Thread
from typing import NamedTuple, TypeVar
from urllib.parse import urlsplit

from requests import RequestException, Response, Session
from requests.adapters import HTTPAdapter
from requests.exceptions import ConnectionError as NoConnection
from requests.exceptions import ProxyError, SSLError, Timeout, TooManyRedirects
from urllib3.exceptions import HTTPError
from urllib3.util import Retry

from tendonrepro import __version__
from tendonrepro.console import Talk
from tendonrepro.dataset.repository.zenodo import at, plain
from tendonrepro.errors import DataMissingError

BY_HAND = "or download the files in a browser; inspect and ingest read any folder"
TOO_MANY = 429
_LATER = f"try again later, {BY_HAND}"


class WebError(DataMissingError):
    """A request that failed for good; `status` of the answer, None where there was none."""

    def __init__(self, message: str, *, hint: str, status: int | None = None) -> None:
        super().__init__(message, hint=hint)
        self.status = status


def unreached(error: Exception, url: str, what: str) -> WebError:
    """Why there was no answer at all."""
    host, text = host_of(url), str(error)
    check = f"check the network, {BY_HAND}"
    # The last cause in what the library says.
    causes = re.findall(r"\[(?:Errno|SSL|WinError)[^\]]*\]\s*([^()'\"]+)", text)
    reason = plain(causes[-1]) if causes else "it was closed"
    if isinstance(error, ProxyError):
        message, hint = f"the proxy for {host} cannot be used", f"check HTTPS_PROXY and NO_PROXY, {BY_HAND}"
    elif isinstance(error, SSLError):
        message = f"no secure connection to {host}: {reason}"
        hint = f"check the clock, and REQUESTS_CA_BUNDLE if your network inspects connections, {BY_HAND}"
    elif isinstance(error, (Timeout, TimeoutError)) or "timed out" in text:
        message, hint = f"{host} does not answer in time", _LATER
    elif isinstance(error, TooManyRedirects):
        message, hint = f"{host} sends from one address to the next without end", _LATER
    elif re.search(r"NameResolution|getaddrinfo|Failed to resolve", text):
        message, hint = f"the name {host} cannot be found", check
    elif isinstance(error, NoConnection):
        message, hint = f"no connection to {host}: {reason}", check
    else:
        message, hint = f"the address or the answer of {host} makes no sense", f"check --base-url, {BY_HAND}"
    return WebError(f"{what}: {message}", hint=hint)


def refused(status: int, url: str, kind: str, said: str, what: str) -> WebError:
    """Why the answer is a refusal, given the type of its content and what it says itself, perhaps nothing."""
    host = host_of(url)
    quoted = f" ({said})" if said else ""
    authors = "ask its authors for the files; inspect and ingest read any folder"
    if status == 403 and "json" not in kind:
        message = f"{what}: {host} refuses this computer or network (403, a web page instead of JSON)"
        return WebError(message, hint=f"try from another network, {BY_HAND}", status=status)
    message, hint = {
        401: (f"{what} is not open to everyone", authors),
        403: (f"{what} is not open to everyone", authors),
        404: (f"{what}: not at {host}", "check its number and --base-url"),
        410: (f"{what}: deleted from {host}", "see whether another version exists, or ask its authors"),
        TOO_MANY: (f"{what}: {host} has had too many requests", f"try again in an hour, {BY_HAND}"),
    }.get(status, (f"{what}: {host} answers {status}", _LATER))
    return WebError(message + quoted, hint=hint, status=status)


def host_of(url: str) -> str:
    """Name and port of the machine an address is on."""
    return urlsplit(url).netloc


PROJECT = "https://doi.org/10.3390/act15050271"
AGENT = f"tendonrepro/{__version__} (+{PROJECT}; reproduction of a published experiment)"
LARGEST_JSON = 4 * 2**20
"""Bytes; a record of a thousand files takes a tenth, and what is parsed may take twenty times as much."""
CHUNK = 2**14
"""Bytes of a body taken at once; those of an unfinished one are lost when the connection ends."""

T = TypeVar("T")


@dataclass(frozen=True)
class Patience:
    """How often to ask, and how long to wait, s.

    Tries for one answer have `backoff` between them, doubled each time, or what the server asks for, up to
    `asked`. The `timeout` is for a connection and for the next bytes; `chunk` for the next :data:`CHUNK`
    bytes of a file, so that no server can keep us with a trickle; `answer` for an answer with all its
    tries, and for a whole JSON.
    """

    tries: int = 4
    backoff: float = 0.25
    asked: int = 60
    timeout: tuple[float, float] = (15.0, 30.0)
    chunk: float = 30.0
    answer: float = 300.0


class CutShortError(Exception):
    """A body that ended early or came too slowly; asking for the rest is worth it."""


class Body(NamedTuple):
    """A file on its way: the first byte of what comes and the size of the whole, where the server says so.

    The chunks raise :class:`CutShortError` when the connection ends.
    """

    start: int | None
    total: int | None
    chunks: Iterator[bytes]


class Web:
    """Asks one repository; proxies come from the environment."""

    def __init__(self, talk: Talk, patience: Patience) -> None:
        self.talk = talk
        self.patience = patience
        # What cannot be reached now is not reached a second later; what was reached may have a bad moment.
        retry = Retry(
            total=patience.tries - 1,
            connect=0,
            other=0,
            status_forcelist={TOO_MANY, 500, 502, 503, 504},
            backoff_factor=patience.backoff,
            retry_after_max=patience.asked,
            raise_on_status=False,
        )
        self._session = Session()
        self._session.headers["User-Agent"] = AGENT
        self._session.max_redirects = 5
        for scheme in ("http://", "https://"):
            self._session.mount(scheme, HTTPAdapter(max_retries=retry))

    def json(self, url: str, what: str) -> object:
        """Get an answer in JSON; `what` names it in messages. A WebError if it does not come."""
        with self._answer(url, what, {"Accept": "application/json"}) as response:
            if "json" not in (kind := _kind_of_body(response.headers)):
                message = f"{what}: {host_of(url)} sent {kind or 'something'} instead of JSON"
                hint = f"look at {url} in a browser: a proxy or a login page may be in the way, {BY_HAND}"
                raise WebError(message, hint=hint, status=response.status_code)
            try:
                return self._parsed(response)
            except (ValueError, RecursionError, CutShortError) as error:
                message = f"{what}: the JSON that {host_of(url)} sent is damaged, cut short, or far too long"
                raise WebError(message, hint=f"try again, {BY_HAND}", status=response.status_code) from error

    @contextmanager
    def body(self, url: str, what: str, start: int = 0, *, page: bool = False) -> Iterator[Body]:
        """Get a file from its byte `start`, though the server may send all of it; else raise a WebError.

        A web page is taken for a message to people, unless the file is one (`page`).
        """
        # A compressed body would make its length and its ranges those of something else.
        headers = {"Accept": "*/*", "Accept-Encoding": "identity"}
        if start:
            headers["Range"] = f"bytes={start}-"
        with self._answer(url, what, headers) as response:
            status, sent = response.status_code, response.headers
            if _kind_of_body(sent) == "text/html" and not page and status != 416:
                message = f"{what}: {host_of(url)} sent a web page instead of the file"
                hint = f"a proxy or a login page may be in the way; try again later, {BY_HAND}"
                raise WebError(message, hint=hint, status=status)
            yield Body(*place_of_body(status, sent), _chunks(response, CHUNK, self.patience.chunk))

    @contextmanager
    def _answer(self, url: str, what: str, headers: dict[str, str]) -> Iterator[Response]:
        get = partial(self._session.get, url, headers=headers, timeout=self.patience.timeout, stream=True)
        try:
            response = _within(self.patience.answer, get)
        except (RequestException, TimeoutError, ValueError) as error:
            # It is a ValueError where a name makes no sense.
            raise unreached(error, url, what) from error
        with response:
            if response.status_code not in {200, 206, 416}:
                kind = _kind_of_body(response.headers)
                said = self._said(response) if "json" in kind else ""
                raise refused(response.status_code, response.url, kind, said, what)
            yield response

    def _said(self, response: Response) -> str:
        """What a refusal says in its JSON, with the note on a deleted record."""
        try:
            tree = self._parsed(response)
        except (ValueError, RecursionError, CutShortError):
            return ""
        reason = at(tree, "tombstone", "removal_reason")
        words = [at(tree, "message"), at(tree, "tombstone", "note"), at(reason, "id") or reason]
        return "; ".join(plain(word).rstrip(".") for word in words if isinstance(word, str) and word.strip())

    def _parsed(self, response: Response) -> object:
        """The JSON of an answer, which is taken as one chunk."""
        text = next(_chunks(response, LARGEST_JSON + 1, self.patience.answer), b"")
        if len(text) > LARGEST_JSON:
            raise CutShortError("more than any record needs")
        return json.loads(text)


def _chunks(response: Response, size: int, seconds: float) -> Iterator[bytes]:
    """A body in chunks of one size, each of which must come in time."""
    try:
        while chunk := _within(seconds, partial(response.raw.read, size, decode_content=True)):
            yield chunk
    except (HTTPError, HTTPException, OSError, ValueError) as error:
        # A thread may still be reading; without this it could not be closed.
        with suppress(OSError, RuntimeError, ValueError):
            response.raw.shutdown()
        raise CutShortError(str(error)) from error


def _within(seconds: float, call: Callable[[], T]) -> T:
    """Call in a thread, because a time limit on a socket begins anew with every byte."""
    future: Future[T] = Future()
    Thread(target=_settle, args=(future, call), daemon=True).start()
    try:
        return future.result(seconds)
    except TimeoutError:
        future.add_done_callback(_give_back)
        raise
    finally:
        # A traceback may keep this frame, and with it a socket.
        del future


def _settle(future: Future[T], call: Callable[[], T]) -> None:
    try:
        future.set_result(call())
    except BaseException as error:
        future.set_exception(error)
    finally:
        del future


def _give_back(late: Future[T]) -> None:
    """Close an answer that comes when nobody waits for it any more."""
    if late.exception() is None and isinstance(answer := late.result(), Response):
        answer.close()


def _kind_of_body(headers: Mapping[str, str]) -> str:
    """Type of the content without its parameters, in lower case; empty if there is none."""
    return plain(headers.get("Content-Type", "").partition(";")[0]).lower()


def place_of_body(status: int, headers: Mapping[str, str]) -> tuple[int | None, int | None]:
    """First byte of what comes, and size of the whole file; None where the server does not say.

    >>> place_of_body(206, {"Content-Range": "bytes 10-19/20"})
    (10, 20)
    """
    if status == 200:
        length = headers.get("Content-Length", "")
        # The length of a compressed body is not that of the file.
        plainly = headers.get("Content-Encoding", "identity") == "identity"
        return 0, int(length) if plainly and re.fullmatch("[0-9]{1,18}", length) else None
    place = headers.get("Content-Range", "").strip()
    found = re.fullmatch(r"bytes ([0-9]{1,18})-[0-9]{1,18}/([0-9]{1,18}|\*)", place)
    return (int(found[1]), None if found[2] == "*" else int(found[2])) if found else (None, None)
