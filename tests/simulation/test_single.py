"""One run's machine code, and where it is kept."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.oracles import FEATURES, PAPER, random_plant, random_state

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen import cache
from tendonrepro.simulation.single import Arm

# Elementary functions are the package's own, and products may be fused with sums; the acceleration of a light
# last link under a stiff tendon multiplies that by some hundreds.
ROUNDING = 1e-12


@pytest.mark.parametrize(("n", "features"), [(1, FEATURES), (2, PAPER), (3, FEATURES)])
def test_compiled_plant_is_the_pure_one(n: int, features: frozenset[str]) -> None:
    rng = np.random.default_rng(n)
    loaded = load_config(None, "compare")
    loop = next(loop for _, loop in build_loops(loaded.config, loaded.folder))
    for seed in range(3):
        plant = random_plant(n, seed, features).plant
        arm = Arm(replace(loop, plant=plant))
        for t in (0.0, 0.5, 0.8):
            state, tau_m = random_state(n, rng), rng.uniform(-5.0, 5.0, n)
            arm.torque[:] = tau_m
            expected = state_derivative(t, state, tau_m, plant)
            assert arm.slope(t, state) == pytest.approx(
                expected, rel=0.0, abs=ROUNDING * np.abs(expected).max()
            )


def test_without_a_usable_cache_a_temporary_folder_serves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("not a folder", encoding="utf-8")
    monkeypatch.setattr(cache.platformdirs, "user_cache_dir", lambda _: str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = cache.cache_folder()
    assert folder.is_dir()
    assert folder.is_relative_to(tmp_path)
