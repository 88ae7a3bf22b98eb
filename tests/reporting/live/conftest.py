"""One page of all presets, one browser, and a configuration whose own preset stands first."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.browser import CHROMIUM, DRIVER, Browser

import tendonrepro as tr

OWN = (
    "control.gains.lam=[6,7]",
    "manipulator.tendons.clearance=[0,0.1,0.1]",
    "manipulator.tensioner.force=20",
)
"""A configuration of a user's: other gains, and effects of the arm that are off as shipped."""


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("live") / "live.html"
    tr.live("plain", path, set=OWN)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("no chromium with its driver on the path")
    with Browser() as held:
        yield held
