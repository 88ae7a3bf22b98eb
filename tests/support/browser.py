"""A headless browser, spoken to by the WebDriver protocol; nothing beyond this machine is asked."""

from __future__ import annotations

import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import requests

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update",
)  # fmt: skip


class Browser:
    """One window; use it in a ``with`` block."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self._profile = tempfile.mkdtemp(prefix="tendonrepro-browser-")
        command = [str(DRIVER), f"--port={port}"]
        self._driver = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._session = requests.Session()
        self._session.trust_env = False
        self._address = f"http://127.0.0.1:{port}"

    def __enter__(self) -> Browser:
        try:
            self._wait_for_driver()
            arguments = [*FLAGS, f"--user-data-dir={self._profile}", "--window-size=1280,900"]
            options = {"args": arguments, "binary": CHROMIUM}
            always = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
            made = self._ask("POST", "/session", {"capabilities": {"alwaysMatch": always}})
        except BaseException:
            self._stop()
            raise
        self._address += f"/session/{made['sessionId']}"
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._ask("DELETE", "")
        finally:
            self._stop()

    def _stop(self) -> None:
        self._session.close()
        self._driver.terminate()
        self._driver.wait(20)
        shutil.rmtree(self._profile, ignore_errors=True)

    def _wait_for_driver(self) -> None:
        end = time.monotonic() + 30.0
        while True:
            try:
                self._ask("GET", "/status")
                return
            except requests.ConnectionError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)

    def _ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        answer = self._session.request(method, self._address + path, json=body or {}, timeout=120)
        assert answer.ok, answer.text[:1000]
        return answer.json()["value"]

    def open(self, path: Path, fragment: str = "") -> None:
        """Load a file anew."""
        self._ask("POST", "/url", {"url": "about:blank"})
        self._ask("POST", "/url", {"url": path.as_uri() + fragment})

    def run(self, script: str, *arguments: Any) -> Any:
        """What a script in the page returns."""
        return self._ask("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def keys(self, selector: str, text: str) -> None:
        """Type into an element; U+E014 and the like are keys without a letter."""
        found = self._ask("POST", "/element", {"using": "css selector", "value": selector})
        (name,) = found.values()
        self._ask("POST", f"/element/{name}/value", {"text": text})

    def width(self, pixels: int, height: int = 850) -> None:
        """Make the page as wide as that."""
        metrics = {"width": pixels, "height": height, "deviceScaleFactor": 1, "mobile": pixels < 600}
        command = {"cmd": "Emulation.setDeviceMetricsOverride", "params": metrics}
        self._ask("POST", "/goog/cdp/execute", command)

    def console(self) -> list[str]:
        """What the console says since the last call."""
        return [entry["message"] for entry in self._ask("POST", "/se/log", {"type": "browser"})]
