"""From a record on a server to a comparison with print and model, by the installed command alone."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import synthetic_record
from support.zenodo_server import RECORD, Repository, serving


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Repository]:
    files = synthetic_record.make_record(tmp_path_factory.mktemp("record"))
    with serving(Repository(files=files)) as repository:
        yield repository


@pytest.fixture(scope="module")
def workplace(
    tmp_path_factory: pytest.TempPathFactory, repository: Repository, command: str
) -> tuple[Path, dict[str, Any]]:
    """An empty folder after all four commands, and what each of them said."""
    folder = tmp_path_factory.mktemp("workplace")
    said: dict[str, Any] = {}

    def run(*words: str) -> None:
        said[words[0]] = call(command, folder, repository, *words, "--json")

    run("fetch", str(RECORD))
    run("inspect", "data/zenodo", "--suggest")
    run("ingest", "data/zenodo")
    run("validate")
    return folder, said


def call(command: str, folder: Path, repository: Repository, *words: str) -> Any:
    environment = os.environ | {"TENDONREPRO_ZENODO_URL": repository.url}
    done = subprocess.run(
        [command, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout) if "--json" in words else done.stdout


pytestmark = pytest.mark.slow


def test_the_record_is_fetched_and_understood_without_being_told(
    workplace: tuple[Path, dict[str, Any]],
) -> None:
    """Its own tables come back: they are not the paper's, so nothing printed can have slipped in."""
    folder, said = workplace
    assert {file["action"] for file in said["fetch"]["files"]} == {"downloaded"}
    lock = json.loads((folder / "data/zenodo.lock.json").read_text())
    assert {file["key"] for file in lock["files"]} == {file["key"] for file in said["fetch"]["files"]}
    assert (folder / "data/zenodo/SYNTHETIC controller1.mat").is_file()
    assert said["inspect"]["runs"] == dict.fromkeys(synthetic_record.SIZES, 4) | {"decouple": 6}
    assert said["inspect"]["left"] == []
    for run, sizes in synthetic_record.expected_sizes().items():
        for name, values in sizes.items():
            np.testing.assert_allclose(said["ingest"]["runs"][run][f"{name}_deg"], values, rtol=1e-9)


def test_files_of_the_comparison_are_there_and_run(
    workplace: tuple[Path, dict[str, Any]], repository: Repository, command: str
) -> None:
    folder, said = workplace
    out = folder / "reports/validate"
    written = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert {"manifest.json", "validation.json", "reference.csv", "compare.yaml", "simulated.h5"} <= written
    assert {f"figures/fig{number:02d}.png" for number in (9, 10, 11, 12, 13, 14, 16)} <= written
    assert said["validate"]["schema_version"] == 1
    config = "reports/validate/compare.yaml"
    assert "valid compare" in call(command, folder, repository, "config", "check", config)


def test_claims_and_figures_take_the_measurement(
    workplace: tuple[Path, dict[str, Any]], repository: Repository, command: str
) -> None:
    folder, _ = workplace
    ledger = call(command, folder, repository, "claims", "K3", "K5", "C2", "--json")
    claims = {claim["id"]: claim for claim in ledger["claims"]}
    assert [claims[name]["verdict"] for name in ("K3", "K5")] == ["reproduced"] * 2
    assert claims["C2"]["evidence"]["measured"]["verdict"] == "not_reproduced"
    (folder / "measured").mkdir()
    (folder / "measured/traces.h5").write_bytes((folder / "data/measured.h5").read_bytes())
    assert "fig14.png" in call(command, folder, repository, "figures", "14", "--out", "measured")
