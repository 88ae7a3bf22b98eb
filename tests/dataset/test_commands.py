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


pytestmark = pytest.mark.slow


def test_from_a_server_to_a_verdict(repository: Repository, command: str, tmp_path: Path) -> None:
    """Its own tables come back: they are not the paper's, so nothing printed can have slipped in."""
    environment = os.environ | {"TENDONREPRO_ZENODO_URL": repository.url}

    def call(*words: str) -> Any:
        done = subprocess.run(
            [command, *words, "--json"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout)

    assert {file["action"] for file in call("fetch", str(RECORD))["files"]} == {"downloaded"}
    assert call("inspect", "data/zenodo", "--suggest")["left"] == []
    runs = call("ingest", "data/zenodo")["runs"]
    for run, sizes in synthetic_record.expected_sizes().items():
        for name, values in sizes.items():
            np.testing.assert_allclose(runs[run][f"{name}_deg"], values, rtol=1e-9)
    call("validate")
    assert (tmp_path / "reports/validate/figures/fig14.png").is_file()
    assert call("config", "check", "reports/validate/compare.yaml")
    claims = {claim["id"]: claim for claim in call("claims", "K3", "C2")["claims"]}
    assert claims["K3"]["verdict"] == "reproduced"
    assert claims["C2"]["evidence"]["measured"]["verdict"] == "not_reproduced"
