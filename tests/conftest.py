"""What every test relies on."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, settings

np.seterr(divide="raise", over="raise", invalid="raise")

# The gate takes the same examples every time, and a busy machine is not a failed law.
# `pytest --hypothesis-profile=default` looks for new examples.
settings.register_profile("gate", derandomize=True, deadline=None)
settings.load_profile("gate")
# For mutation runs: the same examples every time, no clock, and no search for the smallest that fails.
settings.register_profile("mutants", derandomize=True, deadline=None, phases=[Phase.explicit, Phase.generate])


@pytest.fixture(scope="session")
def command() -> str:
    """The installed command, beside the interpreter that runs the tests."""
    path = Path(sys.executable).parent / ("tendonrepro.exe" if sys.platform == "win32" else "tendonrepro")
    assert path.exists(), "install the package first: pip install -e ."
    return str(path)
