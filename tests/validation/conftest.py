"""Validation without its slowest part."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", autouse=True)
def _no_recovery() -> Iterator[None]:
    """Which controller made a run takes ten seconds a run to find, and has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tendonrepro.validation.command.controllers_of", lambda *_: [])
        yield
