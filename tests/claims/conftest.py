"""The made-up ensemble and its paper, and draws of four unknowns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc
from support.made_claims import MadeEnsemble, paper_of

from tendonrepro.config.published import Published


@pytest.fixture
def data() -> MadeEnsemble:
    return MadeEnsemble()


@pytest.fixture
def paper(data: MadeEnsemble) -> Published:
    return paper_of(data)


@pytest.fixture(scope="module")
def draws() -> np.ndarray:
    return qmc.Sobol(4, rng=1).random(1024)
