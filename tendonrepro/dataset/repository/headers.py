"""What the headers of an answer say, as far as they can be believed."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Mapping
from email.utils import parsedate_to_datetime

from tendonrepro.dataset.repository.zenodo import plain


def kind_of_body(headers: Mapping[str, str]) -> str:
    """Type of the content without its parameters, in lower case; empty if there is none.

    Examples
    --------
    >>> kind_of_body({"Content-Type": "Application/JSON; charset=utf-8"})
    'application/json'
    """
    return plain(headers.get("Content-Type", "").partition(";")[0]).strip().lower()


def seconds_asked(headers: Mapping[str, str], otherwise: float) -> float:
    """Seconds the server asks to wait, given as a number or a date.

    Parameters
    ----------
    headers : mapping
    otherwise : float
        s, if it does not say, or says something that is no time.

    Returns
    -------
    float
        Not negative, finite.
    """
    text = headers.get("Retry-After", "")
    try:
        seconds = float(text)
    except ValueError:
        try:
            seconds = parsedate_to_datetime(text).timestamp() - time.time()
        except (ValueError, TypeError, OverflowError, OSError):
            return otherwise
    return max(seconds, 0.0) if math.isfinite(seconds) else otherwise


def place_of_body(status: int, headers: Mapping[str, str]) -> tuple[int | None, int | None]:
    """First byte of what comes, and size of the whole file.

    Parameters
    ----------
    status : int
        200, 206 or 416.
    headers : mapping

    Returns
    -------
    start, total : int or None
        None where the server does not say.

    Examples
    --------
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


def md5_of_body(headers: Mapping[str, str]) -> str | None:
    """Digest in the header ``oc-checksum``, which may have lost its leading zeros.

    Examples
    --------
    >>> md5_of_body({"oc-checksum": "MD5:1f"})
    '0000000000000000000000000000001f'
    """
    found = re.fullmatch(r"md5:([0-9a-f]{1,32})", headers.get("oc-checksum", "").strip(), re.IGNORECASE)
    return found[1].lower().zfill(32) if found else None
