"""The made-up ensemble and its paper, and draws of four unknowns."""

import pytest
from scipy.stats import qmc
from support.made_claims import MadeEnsemble, paper_of


@pytest.fixture
def data():
    return MadeEnsemble()


@pytest.fixture
def paper(data):
    return paper_of(data)


@pytest.fixture(scope="module")
def draws():
    return qmc.Sobol(4, rng=1).random(1024)
