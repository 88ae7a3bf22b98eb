"""A repository on the loopback interface that answers as Zenodo does, also on its bad days.

Everything it offers is SYNTHETIC and says so in titles and keys.
"""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, TypeAlias
from urllib.parse import unquote, urlsplit

RECORD, CONCEPT = 1000002, 1000001
TITLE = "SYNTHETIC record for tests of the download"
PAGE = b"<html><body>SYNTHETIC page of a proxy</body></html>"
SMALL = {
    "SYNTHETIC exp data 1.mat": b"SYNTHETIC " * 4000,
    "SYNTHETIC folder/run.csv": b"time_s,q2_deg\n0,0\n",
    "SYNTHETIC empty.txt": b"",
}
ONE = {"SYNTHETIC run.bin": bytes(range(256)) * 800}
Answers: TypeAlias = dict[str, tuple[int, bytes]]
"""Status and body by the name of a bad day."""
OF_ALL: Answers = {"refused": (403, PAGE)}
OF_FILES: Answers = {
    "closed_content": (403, b'{"message": "Permission denied."}'),
    "page_content": (200, PAGE),
}
OF_RECORDS: Answers = {
    "deleted": (410, b'{"message": "Record deleted"}'),
    "page": (200, PAGE),
    "broken_json": (200, b'{"id": 10000'),
}
PASSING: Answers = {"busy": (429, b'{"message": "30 per 1 minute"}'), "gateway": (504, PAGE)}


@dataclass
class Repository:
    """One record, how it is told, and what went on.

    `modes` are names of bad days; `failures` is how often those that pass come back.
    """

    files: dict[str, bytes] = field(default_factory=lambda: dict(SMALL))
    modes: set[str] = field(default_factory=set)
    failures: int = 10**6
    cut_at: int = 50_000
    url: str = ""
    log: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    release: threading.Event = field(default_factory=threading.Event)

    def ranges(self) -> list[str | None]:
        """Range of every request for a file."""
        return [headers.get("range") for path, headers in self.log if "/files/" in path]

    def fails(self, mode: str) -> bool:
        """Whether a bad day that passes is still on."""
        if mode not in self.modes or self.failures <= 0:
            return False
        self.failures -= 1
        return True

    def checksum(self, content: bytes) -> str:
        wrong = b"other" if "wrong_md5" in self.modes else b""
        return f"md5:{hashlib.md5(content + wrong).hexdigest()}"

    def record(self) -> dict[str, Any]:
        hidden = self.modes & {"restricted", "closed_files"}
        shown = [
            {"key": key, "size": len(content), "checksum": self.checksum(content)}
            for key, content in self.files.items()
            if not hidden
        ]
        meta = {"title": TITLE, "version": "v1", "license": {"id": "cc-by-4.0"}}
        return {"id": RECORD, "doi": f"10.5281/zenodo.{RECORD}", "metadata": meta, "files": shown}


class Handler(BaseHTTPRequestHandler):
    """One request."""

    protocol_version = "HTTP/1.1"
    server: Server

    def log_message(self, format: str, *args: Any) -> None:  # the name is inherited
        """Nothing on standard error."""
        del format, args

    def do_GET(self) -> None:
        repository = self.server.repository
        headers = {key.lower(): value for key, value in self.headers.items()}
        repository.log.append((self.path, headers))
        path = unquote(urlsplit(self.path).path)
        found = re.fullmatch(rf"/api/records/{RECORD}/files/(.+)/content", path)
        bad = OF_FILES if found else OF_RECORDS
        agent = headers.get("user-agent", "")
        if not agent or agent.startswith("python-requests"):
            self.send(*OF_ALL["refused"])
        elif passing := next(filter(repository.fails, PASSING), None):
            self.send(*PASSING[passing], {"Retry-After": "0"})
        elif lasting := next((mode for mode in {**OF_ALL, **bad} if mode in repository.modes), None):
            self.send(*{**OF_ALL, **bad}[lasting])
        elif found and found[1] in repository.files:
            self.send_bytes(repository.files[found[1]])
        elif path == f"/api/records/{CONCEPT}":
            self.send(302, b"", {"Location": f"{repository.url}/api/records/{RECORD}"})
        elif path == f"/api/records/{RECORD}":
            self.send(200, json.dumps(repository.record()).encode())
        else:
            self.send(404, b'{"message": "The persistent identifier does not exist."}')

    def send_bytes(self, content: bytes) -> None:
        repository = self.server.repository
        modes = repository.modes
        content += b"more" if "longer" in modes else b""
        headers = {"Accept-Ranges": "bytes"}
        asked = re.fullmatch(r"bytes=([0-9]+)-", self.headers.get("Range", ""))
        start = int(asked[1]) if asked and "no_range" not in modes else 0
        if start:
            headers["Content-Range"] = f"bytes {start}-{len(content) - 1}/{len(content)}"
            content = content[start:]
        cut, stuck = repository.fails("cut"), repository.fails("stuck")
        stop = repository.cut_at if cut or stuck else None
        self.send(206 if start else 200, content, headers, stop)
        if stuck:
            repository.release.wait(30.0)

    def send(
        self, status: int, content: bytes, extra: Mapping[str, str] | None = None, stop: int | None = None
    ) -> None:
        """Answer; `stop` ends the body early."""
        self.send_response(status)
        is_page = content.startswith(b"<html>")
        self.send_header("Content-Type", "text/html; charset=utf-8" if is_page else "application/json")
        for name, value in (extra or {}).items():
            self.send_header(name, value)
        if stop is None and "chunked" in self.server.repository.modes:
            self.send_header("Connection", "close")
        else:
            self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content[:stop])
        self.wfile.flush()
        self.close_connection = self.close_connection or stop is not None


class Server(ThreadingHTTPServer):
    """On a free port of the loopback interface."""

    daemon_threads = True

    def __init__(self, repository: Repository) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.repository = repository
        repository.url = f"http://127.0.0.1:{self.server_address[1]}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that was killed is part of the play."""
        del request, client_address


@contextmanager
def serving(repository: Repository) -> Iterator[Repository]:
    """Answer while the block runs."""
    server = Server(repository)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield repository
    finally:
        repository.release.set()
        server.shutdown()
        server.server_close()
        thread.join(5.0)
