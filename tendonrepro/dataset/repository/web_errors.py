"""Requests that failed: each failure in one sentence, with a way out."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from tendonrepro.dataset.repository.zenodo import plain
from tendonrepro.errors import DataMissingError

BY_HAND = "or download the files in a browser and use --from-dir DIR"
TOO_MANY = 429


class WebError(DataMissingError):
    """A request that failed for good.

    Attributes
    ----------
    status : int or None
        Of the answer; None where there was none.
    """

    def __init__(self, message: str, *, hint: str, status: int | None = None) -> None:
        super().__init__(message, hint=hint)
        self.status = status


def passing(error: Exception) -> bool:
    """Whether the next try may go better."""
    from requests.exceptions import ConnectTimeout, ProxyError, ReadTimeout, SSLError

    if isinstance(error, (SSLError, ProxyError, ConnectTimeout)):
        return False
    return isinstance(error, ReadTimeout) or bool(
        re.search(r"aborted|RemoteDisconnected|reset", str(error), re.I)
    )


def unreached(error: Exception, url: str, what: str) -> WebError:
    """Why there was no answer at all."""
    from requests.exceptions import ConnectionError as NoConnection
    from requests.exceptions import ProxyError, SSLError, Timeout, TooManyRedirects

    host, text = host_of(url), str(error)
    check, retry = f"check the network, {BY_HAND}", f"try again later, {BY_HAND}"
    if isinstance(error, ProxyError):
        message, hint = f"the proxy for {host} cannot be used", f"check HTTPS_PROXY and NO_PROXY, {BY_HAND}"
    elif isinstance(error, SSLError):
        message = f"no secure connection to {host}: {plain(_reason(text))}"
        hint = f"check the clock, and REQUESTS_CA_BUNDLE if your network inspects connections, {BY_HAND}"
    elif isinstance(error, Timeout):
        message, hint = f"{host} does not answer in time", retry
    elif isinstance(error, TooManyRedirects):
        message, hint = f"{host} sends from one address to the next without end", retry
    elif re.search(r"NameResolution|getaddrinfo|Failed to resolve", text):
        message, hint = f"the name {host} cannot be found", check
    elif isinstance(error, NoConnection):
        message, hint = f"no connection to {host}: {plain(_reason(text))}", check
    else:
        message, hint = f"the address or the answer of {host} makes no sense", f"check --base-url, {BY_HAND}"
    return WebError(f"{what}: {message}", hint=hint)


def _reason(text: str) -> str:
    """The last cause in what the library says."""
    found = re.findall(r"\[(?:Errno|SSL|WinError)[^\]]*\]\s*([^()'\"]+)", text)
    return str(found[-1]).strip() if found else "it was closed"


def refused(status: int, url: str, kind: str, said: str, what: str) -> WebError:
    """Why the answer is a refusal.

    Parameters
    ----------
    status : int
    url : str
    kind : str
        Content type of the answer.
    said : str
        What the answer says itself; empty when nothing.
    what : str
        Name of the thing asked for.
    """
    host = host_of(url)
    quoted = f" ({said})" if said else ""
    retry = f"try again later, {BY_HAND}"
    closed = (
        f"{what} is not open to everyone{quoted}",
        "ask its authors for the files, then use --from-dir DIR",
    )
    message, hint = {
        401: closed,
        403: closed,
        404: (f"{what}: not at {host}{quoted}", "check its number and --base-url"),
        410: (
            f"{what}: deleted from {host}{quoted}",
            "see whether another version exists, or ask its authors",
        ),
        TOO_MANY: (f"{what}: {host} has had too many requests{quoted}", f"try again in an hour, {BY_HAND}"),
    }.get(status, (f"{what}: {host} answers {status}{quoted}", retry))
    if status == 403 and "json" not in kind:
        message = f"{what}: {host} refuses this computer or network (403, a web page instead of JSON)"
        hint = f"try from another network, {BY_HAND}"
    return WebError(message, hint=hint, status=status)


def host_of(url: str) -> str:
    """Name and port of the machine an address is on."""
    return urlsplit(url).netloc
