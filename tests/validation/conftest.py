"""Validation without its slowest part."""

import pytest

FOUND = [
    {"run": "controller_1", "joint": 2, "answer": "recovered", "surface": "ntsm"},
    {"run": "controller_1", "joint": 3, "answer": "cannot tell"},
]
"""What stands in for what `recover` finds: a row may lack what is not known."""


@pytest.fixture(scope="module", autouse=True)
def _no_recovery():
    """Which controller made a run takes ten seconds a run to find, and has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tendonrepro.validation.command.controllers_of", lambda *_: FOUND)
        yield
