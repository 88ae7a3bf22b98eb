"""The typical plant is the stable sample nearest to the medians, and the shipped comparison has it."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from support.pages import DOCS, NEEDS_DOCS

from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.quantity import to_si
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import simulate_batch

pytestmark = NEEDS_DOCS


@pytest.fixture
def typical(monkeypatch: pytest.MonkeyPatch) -> Any:
    """docs/typical_arm.py."""
    monkeypatch.syspath_prepend(DOCS)
    return importlib.import_module("typical_arm")


def test_it_is_the_stable_sample_nearest_to_the_medians(typical: Any) -> None:
    sizes = np.array([1.0, 10.0, 100.0, 9.0, 1e-3])
    stable = np.array([True, True, True, True, False])
    logs = np.log(sizes[:, np.newaxis] * np.ones(16))
    found = typical.Preliminary(np.arange(5.0)[:, np.newaxis], logs, stable)
    assert found.typical() == [3.0], "the median of 1, 9, 10 and 100 in logarithms is 9.5"
    assert found.distances(logs)[0] == pytest.approx(np.log(np.sqrt(90.0)))
    assert typical.Preliminary(found.values, logs, ~stable).typical() == [4.0]


def test_samples_are_rounded_in_the_unit_of_their_range(typical: Any) -> None:
    study = typical.published_study()
    box = study.population
    low, high = (np.array([getattr(row, end) for row in box.rows]) for end in ("low", "high"))
    values = low + 0.123456 * (high - low)
    found = dict(zip(box.names, typical.rounded(study, values), strict=True))
    assert np.rad2deg(found["amplitude"]) == pytest.approx(14.0)
    assert found["rotor_inertia"] == pytest.approx(4.3e-6)
    assert found["reference_lag"] == pytest.approx(2.5e-3)


def test_the_shipped_one_is_stable_and_uses_nothing_of_the_paper_s_results() -> None:
    loaded = load_config(None, "compare")
    assert isinstance(loaded.config, CompareConfig)
    batch = simulate_batch([*dict(build_loops(loaded.config, loaded.folder)).values()])
    assert (batch.status == STATUSES.index("ok")).all()
    assert "identified" not in loaded.yaml_text
    assert loaded.config.manipulator.tendons.damping_factor.si == 1.0


@pytest.mark.slow
def test_the_shipped_one_is_found_again(typical: Any) -> None:
    study = typical.published_study()
    found = typical.typical_sections(study, typical.preliminary(study))
    shipped = load_config(None, "compare").config.model_dump(mode="json", exclude_none=True)
    for name in typical.SECTIONS:
        ours, theirs = dict(values_of(found[name])), dict(values_of(shipped[name]))
        assert ours.keys() == theirs.keys()
        for place, value in theirs.items():
            assert ours[place] == (value if isinstance(value, str) else pytest.approx(value, rel=1e-5)), place


def values_of(node: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers of a section in SI units, and its words, by their places."""
    if isinstance(node, dict) and {"value", "unit"} <= node.keys():
        scale = to_si(1.0, node["unit"]) if node["unit"] else 1.0
        yield from ((f"{place}.{k}", scale * number) for k, number in enumerate(np.ravel(node["value"])))
    elif isinstance(node, dict | list):
        for key, held in node.items() if isinstance(node, dict) else enumerate(node):
            if key != "source":
                yield from values_of(held, f"{place}.{key}")
    else:
        yield place, node
