"""Ensembles that several files ask about."""

import pytest
from support.fake_batch import run_ensemble_of
from support.made_ensemble import ensemble, random_errors, random_statuses


@pytest.fixture(scope="session")
def mixed():
    """In memory: plants of every status, on which the printed order holds by halves."""
    return ensemble(random_errors, random_statuses)


@pytest.fixture(scope="session", autouse=True)
def no_figures():
    """Figures take most of the time of a run and have tests of their own."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("tendonrepro.monte_carlo.ensemble.ensemble_figures", lambda *_: {})
        yield


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    """On disk: the small study, run to its end."""
    folder = tmp_path_factory.mktemp("unbroken")
    run_ensemble_of(folder)
    return folder
