"""Requests that failed: each failure in one sentence, with a way out."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from requests.exceptions import ConnectionError as NoConnection
from requests.exceptions import ProxyError, SSLError, Timeout, TooManyRedirects

from tendonrepro.dataset.repository.zenodo import plain
from tendonrepro.errors import DataMissingError

BY_HAND = "or download the files in a browser and use --from-dir DIR"
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
    authors = "ask its authors for the files, then use --from-dir DIR"
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
