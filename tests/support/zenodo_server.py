"""A repository on the loopback interface that answers as Zenodo does, also on its bad days.

Everything it offers is SYNTHETIC and says so in titles and keys.
"""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import quote, unquote, urlsplit

RECORD, CONCEPT = 1000002, 1000001
TITLE = "SYNTHETIC record for tests of the download"
PAGE = b"<html><body>SYNTHETIC page of a proxy</body></html>"
SMALL = {
    "SYNTHETIC exp data 1.mat": b"SYNTHETIC " * 4000,
    "SYNTHETIC folder/run.csv": b"time_s,q2_deg\n0,0\n",
    "SYNTHETIC empty.txt": b"",
}
ONE = {"SYNTHETIC run.bin": bytes(range(256)) * 800}


@dataclass
class Repository:
    """One record, how it is told, and what went on.

    `modes` are names of the bad days below; `failures` is how often those that pass come back.
    """

    files: dict[str, bytes] = field(default_factory=lambda: dict(SMALL))
    modes: set[str] = field(default_factory=set)
    failures: int = 10**6
    retry_after: str | None = "0"
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
        place = f"{self.url}/api/records/{RECORD}/files"
        hidden = self.modes & {"restricted", "closed_files"}
        shown = [
            {"key": key, "size": len(content), "checksum": self.checksum(content)}
            | {"links": {"self": f"{place}/{quote(key)}/content"}}
            for key, content in self.files.items()
            if not hidden
        ]
        meta: dict[str, Any] = {"title": TITLE, "version": "v1", "license": {"id": "cc-by-4.0"}}
        meta["access_right"] = "restricted" if "restricted" in self.modes else "open"
        parent = {"pid_type": "recid", "pid_value": str(CONCEPT)}
        meta["relations"] = {"version": [{"index": 0, "is_last": True, "parent": parent}]}
        head = {"id": RECORD, "recid": str(RECORD), "conceptrecid": str(CONCEPT)}
        dois = {"doi": f"10.5281/zenodo.{RECORD}", "conceptdoi": f"10.5281/zenodo.{CONCEPT}"}
        return head | dois | {"title": TITLE, "metadata": meta, "files": shown, "swh": None}


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
        agent = headers.get("user-agent", "")
        path = unquote(urlsplit(self.path).path)
        if not agent or agent.startswith("python-requests") or "refused" in repository.modes:
            self.send(403, PAGE, "text/html")
        elif repository.fails("busy"):
            extra = {"Retry-After": repository.retry_after} if repository.retry_after is not None else {}
            self.send_json(429, {"message": "30 per 1 minute", "status": 429}, extra)
        elif repository.fails("gateway"):
            self.send(504, PAGE, "text/html")
        elif found := re.fullmatch(rf"/api/records/{RECORD}/files/(.+)/content", path):
            self.send_file(found[1])
        else:
            self.send_record(path)

    def send_record(self, path: str) -> None:
        repository = self.server.repository
        modes = repository.modes
        if path == f"/api/records/{CONCEPT}":
            self.send(302, b"", "text/html", {"Location": f"{repository.url}/api/records/{RECORD}"})
        elif path != f"/api/records/{RECORD}":
            self.send_json(404, {"status": 404, "message": "The persistent identifier does not exist."})
        elif "deleted" in modes:
            stone = {"note": "SYNTHETIC note: withdrawn", "removal_reason": {"id": "retracted"}}
            self.send_json(410, {"status": 410, "message": "Record deleted", "tombstone": stone})
        elif "page" in modes:
            self.send(200, PAGE, "text/html")
        elif "broken_json" in modes:
            self.send(200, b'{"id": 10000', "application/json")
        else:
            self.send_json(200, repository.record())

    def send_file(self, key: str) -> None:
        repository = self.server.repository
        modes = repository.modes
        content = repository.files.get(key)
        if content is None:
            self.send_json(404, {"status": 404, "message": f"Record '{RECORD}' has no file '{key}'."})
        elif "closed_content" in modes:
            self.send_json(403, {"status": 403, "message": "Permission denied."})
        elif "page_content" in modes:
            self.send(200, PAGE, "text/html; charset=utf-8")
        else:
            self.send_bytes(content + b"more" if "longer" in modes else content)

    def send_bytes(self, content: bytes) -> None:
        repository = self.server.repository
        modes = repository.modes
        headers = {"Accept-Ranges": "bytes", "Retry-After": "60"}
        asked = re.fullmatch(r"bytes=([0-9]+)-", self.headers.get("Range", ""))
        start = int(asked[1]) if asked and "no_range" not in modes else 0
        if start:
            headers["Content-Range"] = f"bytes {start}-{len(content) - 1}/{len(content)}"
            content = content[start:]
        status = 206 if start else 200
        cut, stuck = repository.fails("cut"), repository.fails("stuck")
        stop = repository.cut_at if cut or stuck else None
        length = cut or stuck or "chunked" not in modes
        self.send(status, content, "application/octet-stream", headers, stop=stop, wait=stuck, length=length)

    def send_json(self, status: int, tree: Any, extra: dict[str, str] | None = None) -> None:
        self.send(status, json.dumps(tree).encode(), "application/json", extra)

    def send(
        self,
        status: int,
        content: bytes,
        kind: str,
        extra: dict[str, str] | None = None,
        *,
        stop: int | None = None,
        wait: bool = False,
        length: bool = True,
    ) -> None:
        """Answer; `stop` ends the body early, `wait` keeps the line open after that."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        for name, value in (extra or {}).items():
            self.send_header(name, value)
        if length:
            self.send_header("Content-Length", str(len(content)))
        else:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content[:stop])
        self.wfile.flush()
        if wait:
            self.server.repository.release.wait(30.0)
        if stop is not None:
            self.close_connection = True


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
