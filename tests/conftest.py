"""What every test relies on."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Generator, Iterator
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, settings
from matplotlib.figure import Figure

np.seterr(divide="raise", over="raise", invalid="raise")

# The gate takes the same examples every time, and a busy machine is not a failed law.
# `pytest --hypothesis-profile=default` looks for new examples.
settings.register_profile("gate", derandomize=True, deadline=None)
settings.load_profile("gate")
# For mutation runs: the same examples every time, no clock, and no search for the smallest that fails.
settings.register_profile("mutants", derandomize=True, deadline=None, phases=[Phase.explicit, Phase.generate])

PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")
NOWHERE = "http://127.0.0.1:9"
"""Nobody listens there: what a child process wants to send past the loopback interface ends here."""

all_formats: list[object] = []
"""Marks of the running test that have pictures drawn in every format."""

strays: list[str] = []
"""Addresses beyond this machine that the running test has asked for."""


@pytest.fixture(scope="session")
def command() -> str:
    """The installed command, beside the interpreter that runs the tests."""
    path = Path(sys.executable).parent / ("tendonrepro.exe" if sys.platform == "win32" else "tendonrepro")
    assert path.exists(), "install the package first: pip install -e ."
    return str(path)


def is_here(host: object) -> bool:
    """Whether a host is this machine."""
    name = host.decode() if isinstance(host, bytes) else host
    if name in {None, "", "localhost", socket.gethostname()}:
        return True
    try:
        address = ip_address(str(name).partition("%")[0])
    except ValueError:
        return False
    return address.is_loopback or address.is_unspecified


def only_here(family: int, address: Any) -> None:
    """Refuse an address that is not on this machine, and remember it for when the refusal is swallowed."""
    if family in {socket.AF_INET, socket.AF_INET6} and not is_here(address[0]):
        strays.append(str(address))
        pytest.fail(f"a test tried to reach {address}")


@pytest.fixture(scope="session", autouse=True)
def _one_process() -> Iterator[None]:
    """Do work in the process of the test: the workers of a pool would start anew for every command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)
        yield


@pytest.fixture(scope="session", autouse=True)
def _quick_pictures() -> Iterator[None]:
    """Draw no PDF and coarse PNG, but in slow tests and those marked `pictures`: they take longest."""
    draw = Figure.savefig

    def drawn(self: Figure, file: Any, **options: Any) -> None:
        if any(all_formats) or options.get("format") not in {"pdf", "png"}:
            draw(self, file, **options)
        elif options["format"] == "png":
            draw(self, file, **options | {"dpi": 40})
        else:
            file.write(b"not drawn")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", drawn)
        yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Note whether the test has every format drawn, and fine."""
    all_formats[:] = [item.get_closest_marker(name) for name in ("slow", "pictures")]


@pytest.fixture(scope="session", autouse=True)
def _no_network(request: pytest.FixtureRequest) -> Iterator[None]:
    """Keep every test on this machine, its child processes too."""
    if any(item.get_closest_marker("network") for item in request.session.items):
        yield
        return
    connect, connect_ex, resolve = socket.socket.connect, socket.socket.connect_ex, socket.getaddrinfo

    def guarded_connect(self: socket.socket, address: Any) -> None:
        only_here(self.family, address)
        connect(self, address)

    def guarded_connect_ex(self: socket.socket, address: Any) -> int:
        only_here(self.family, address)
        return connect_ex(self, address)

    def guarded_resolve(host: Any, *args: Any, **options: Any) -> Any:
        only_here(socket.AF_INET, (host,))
        return resolve(host, *args, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", guarded_connect)
        patch.setattr(socket.socket, "connect_ex", guarded_connect_ex)
        patch.setattr(socket, "getaddrinfo", guarded_resolve)
        for name in PROXIES:
            patch.setitem(os.environ, name, NOWHERE)
            patch.setitem(os.environ, name.lower(), NOWHERE)
        for name in ("NO_PROXY", "no_proxy"):
            patch.setitem(os.environ, name, "127.0.0.1,localhost,::1")
        yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """A stray request fails its test even from a thread, or where every exception is caught."""
    del item
    strays.clear()
    result = yield
    if strays:
        pytest.fail(f"the test tried to reach {', '.join(strays)}")
    return result
