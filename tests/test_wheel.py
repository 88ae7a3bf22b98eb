"""The wheel alone is enough: configurations and printed numbers are inside, any folder will do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from functools import partial
from pathlib import Path

import pytest
from support import ROOT


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(
        [sys.executable, "-m", "pip", "--disable-pip-version-check", *words], check=True, timeout=120
    )
    return next(folder.glob("*.whl"))


def test_the_wheel_holds_the_data_and_nothing_else(wheel: Path) -> None:
    names = {
        name for name in zipfile.ZipFile(wheel).namelist() if not name.split("/")[0].endswith(".dist-info")
    }
    shipped = {
        "configs/**/*",
        "data/published.yaml",
        "docs/results/*",
        "docs/slips.md",
        "docs/predictions.md",
    }
    expected = {
        f"tendonrepro/{path.relative_to(ROOT)}"
        for some in shipped
        for path in ROOT.glob(some)
        if path.is_file()
    }
    own = [path for path in (ROOT / "tendonrepro").rglob("*") if path.suffix not in {".py", ".pyc"}]
    expected |= {path.relative_to(ROOT).as_posix() for path in own if path.is_file()}
    # The mark by which type checkers see the package's types.
    assert "tendonrepro/py.typed" in names
    assert {name for name in names if not name.endswith(".py")} == expected
    assert all(name.startswith("tendonrepro/") for name in names)


@pytest.mark.slow
def test_the_wheel_works_in_an_empty_folder(wheel: Path, tmp_path: Path) -> None:
    site, empty = tmp_path / "site", tmp_path / "empty"
    empty.mkdir()
    zipfile.ZipFile(wheel).extractall(site)
    environment = os.environ | {"PYTHONPATH": str(site)}

    def python(*words: str) -> str:
        command = [sys.executable, *words]
        done = subprocess.run(
            command, cwd=empty, env=environment, capture_output=True, text=True, check=True, timeout=120
        )
        return done.stdout

    run = partial(python, "-m", "tendonrepro")
    assert python("-c", "import tendonrepro; print(tendonrepro.__file__)").startswith(str(site))
    assert "not a checkout" in run("--version", "--verbose")
    assert json.loads(run("claims", "C2", "--json"))["ensemble"]["source"] == "shipped"
    data = json.loads(
        run(
            *("compare", "--controllers", "2", "--json", "--out", "out"),
            *("--set", "reference.periods=1", "--set", "reference.amplitude=[2,2]"),
        )
    )
    assert data["printed"]["table2"]["controller_2"]["rmse_deg"] == [None, None]
    assert run("report", ".", "--json", "--out", "out/report.html")
    assert [path.name for path in empty.iterdir()] == ["out"]
