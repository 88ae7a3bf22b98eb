from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from support import ROOT
from support.oracles import FEATURES, PAPER, random_plant, random_state

from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics import control
from tendonrepro.physics.control import remember, start_memory
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen import cache, compiled, dop853
from tendonrepro.simulation.codegen.symbols import unrolled

# Only sin, cos, tanh and exp may differ, in the last bit; the acceleration of a light last link under a stiff
# tendon multiplies that by some hundreds.
ROUNDING = 1e-12


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("features", [frozenset(), PAPER, FEATURES], ids=["none", "paper", "all"])
def test_compiled_plant_is_the_pure_one(n: int, features: frozenset[str]) -> None:
    rng = np.random.default_rng(n)
    for seed in range(3):
        plant = random_plant(n, seed, features).plant
        code, p = compiled.compiled_plant(plant)
        for t in (0.0, 0.5, 0.8):
            state, tau_m = random_state(n, rng), rng.uniform(-5.0, 5.0, n)
            expected = state_derivative(t, state, tau_m, plant)
            got = np.empty(4 * n)
            compiled.derivative(code, t, state, tau_m, p, got)
            assert got == pytest.approx(expected, rel=0.0, abs=ROUNDING * np.abs(expected).max())
            plain = np.empty(4 * n)
            dop853.derivative(code, t, state, tau_m, p, plain)
            np.testing.assert_array_equal(plain, got)


def test_plants_with_the_same_features_share_machine_code() -> None:
    first, second, other = (
        compiled.compiled_plant(random_plant(2, seed, features).plant)
        for seed, features in ((1, FEATURES), (2, FEATURES), (1, PAPER))
    )
    assert first[0] == second[0] != other[0]
    assert (first[1] != second[1]).any()


@pytest.mark.parametrize("name", ["controller_1", "controller_2", "controller_3", "tdc"])
@pytest.mark.parametrize(
    "override",
    [
        "control.readings.phi_branch=printed",
        "control.readings.phi_branch=power",
        "control.readings.differencing=centred",
        "control.readings.gain_unit=law_in_degrees",
        "control.readings.torque_coordinates=winch",
        "control.readings.delay_time=four_periods",
        "control.readings.estimate_filter=acceleration",
        "control.readings.estimate_filter=estimate",
        "control.readings.error_rate=difference_of_error",
    ],
)
def test_compiled_law_is_the_pure_one(name: str, override: str) -> None:
    config = load_config(None, "compare", overrides=[override]).config
    assert isinstance(config, CompareConfig)
    law = build_law(config, name)
    rng = np.random.default_rng(1)
    memory = start_memory(np.zeros(2), rng.uniform(-5.0, 5.0, 2), law.lag)
    for _ in range(20):
        q, q_d = rng.normal(0.0, 1e-3, (2, 2))
        dq_d, ddq_d = rng.normal(0.0, 0.1, (2, 2))
        got = compiled.command(memory, q, q_d, dq_d, ddq_d, law)
        expected = control.command(memory, q, q_d, dq_d, ddq_d, law)
        for ours, pure in zip(got, expected, strict=True):
            assert ours == pytest.approx(pure, rel=1e-12, abs=1e-12 * max(1.0, np.abs(pure).max()))
        memory = remember(memory, q, q_d, expected[3], expected[1], expected[0], law)


class TestCache:
    def test_code_of_a_plant_lies_in_a_file_named_after_its_content(self) -> None:
        plant = random_plant(2, 1, PAPER).plant
        source, _ = unrolled(state_derivative, plant, 2)
        compiled.compiled_plant(plant)
        path = cache.cache_folder() / f"compiled_{hashlib.sha256(source.encode()).hexdigest()[:16]}.py"
        assert path.read_text(encoding="utf-8") == source.replace("def compiled(", f"def {path.stem}(")

    def test_folder_follows_the_sources(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setattr(cache.platformdirs, "user_cache_dir", lambda _: str(tmp_path))
        now = cache.cache_folder()
        assert now.is_dir()
        assert now.is_relative_to(tmp_path)
        assert cache.cache_folder() == now
        changed = Path(shutil.copy(control.__file__, tmp_path / "control.py"))
        with changed.open("a", encoding="utf-8") as file:
            file.write("# changed\n")
        real = cache.sources()
        assert Path(control.__file__) in real
        sources = [changed if one == Path(control.__file__) else one for one in real]
        monkeypatch.setattr(cache, "sources", lambda: sources)
        assert cache.cache_folder() != now

    def test_without_a_usable_cache_a_temporary_folder_serves(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        blocked = tmp_path / "file"
        blocked.write_text("not a folder", encoding="utf-8")
        monkeypatch.setattr(cache.platformdirs, "user_cache_dir", lambda _: str(blocked))
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        folder = cache.cache_folder()
        assert folder.is_dir()
        assert folder.is_relative_to(tmp_path)
        assert cache.cache_folder() == folder, "one folder serves all processes"
        # Who else can write there could have code of theirs run.
        above = folder.parents[1]
        for mode, ours in ((0o777, False), (0o755, True)):
            above.chmod(mode)
            assert (cache.cache_folder() == folder) is ours
        above.rename(tmp_path / "elsewhere")
        above.symlink_to(tmp_path / "elsewhere")
        assert not cache.cache_folder().is_relative_to(above)

    def test_code_that_was_cut_short_is_compiled_anew(self, tmp_path: Path) -> None:
        whole, cut, empty = (tmp_path / "a" / name for name in ("whole.nbi", "cut.nbc", "empty.nbi"))
        whole.parent.mkdir()
        whole.write_bytes(pickle.dumps("code"))
        cut.write_bytes(pickle.dumps("code")[:-3])
        empty.touch()
        cache._drop_broken(tmp_path)
        assert (whole.exists(), cut.exists(), empty.exists()) == (True, False, False)

    @pytest.mark.slow
    def test_a_second_process_compiles_nothing(self, tmp_path: Path) -> None:
        """Fills an empty cache in one process and uses it in another."""
        script = tmp_path / "use.py"
        script.write_text(
            "import sys\n"
            f"sys.path.insert(0, {str(ROOT / 'tests')!r})\n"
            "import numpy as np\n"
            "from support.oracles import FEATURES, random_plant\n"
            "from tendonrepro.simulation.codegen import compiled\n"
            "code, p = compiled.compiled_plant(random_plant(2, 1, FEATURES).plant)\n"
            "compiled.advance(code, 0.0, 1e-3, np.zeros(8), np.zeros(2), p, 1e-5, 1e-7, 1e-3)\n"
            "(plant,) = compiled._plants.values()\n"
            "hits = plant.cache_hits, sum(compiled.advance.stats.cache_hits.values())\n"
            "sys.stdout.write(str(hits))\n",
            encoding="utf-8",
        )
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path)}
        environment["PYTHONPATH"] = str(ROOT)
        hits = [
            subprocess.run(
                [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=True
            ).stdout
            for _ in range(2)
        ]
        assert hits == ["(0, 0)", "(1, 1)"]
