"""What every command answers, kept in files: a change of structure moves no digit.

Each case runs its commands in an empty folder and compares their ``--json`` with ``<case>.json`` beside this
file. Keys may be added. Paths, versions, digests and sentences are no part of it.

Encoder steps make a run chaotic: another processor or library moves its fourth digit. So numbers of
simulations are held to 1e-9 where they were made (``made_on.json``), and to `Case.loose` elsewhere.

Make the files again after a change that should move them, and say in the commit why:
``GOLDEN=write python -m pytest tests/golden -m "" -k compare``.
"""

from __future__ import annotations

import json
import math
import os
import platform
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from llvmlite.binding import get_host_cpu_features
from support.command import SHORT
from support.synthetic_record import make_record
from typer.testing import CliRunner

from tendonrepro.cli.app import app
from tendonrepro.results.store import cpu_name

FOLDER = Path(__file__).parent
MADE_ON = FOLDER / "made_on.json"
WRITE = os.environ.get("GOLDEN") == "write"
# Processors of one name may have other vector units, and round otherwise.
VECTORS = "avx512f" if get_host_cpu_features().get("avx512f") else "others"
HERE = {
    "cpu": f"{cpu_name()}, {VECTORS}",
    "system": platform.system(),
    "numpy": np.__version__,
    "scipy": scipy.__version__,
}
AS_MADE = MADE_ON.exists() and json.loads(MADE_ON.read_text(encoding="utf-8")) == HERE

NOT_KEPT = re.compile(
    "out|manifest|files?|size|spot_check|text|evidence|conclusions|sources?|identity|created|md5|cost|resumed_from"
    "|populations|blocks|.*(version|sha256|per_second|because|_at_s|^at_s)"
)
SENTENCE = 4
"""Words of a string that is not kept."""
KEPT_READINGS = {"printed", "weights=extrapolating", "gain_unit=phi_in_degrees"}
"""Of an ensemble, whose answer would be two megabytes."""
ONE_PERIOD = shlex.join(SHORT)
SMALL_ENSEMBLE = (
    "--draws 64 --jobs 2 --set block.value=16 --set scramblings.value=4 "
    "--set populations.firm.share.value=1 --set pairs=[] --set variations=[]"
)


@dataclass(frozen=True)
class Case:
    """Commands run one after the other, and how closely their numbers agree with the file.

    `loose` is the relative tolerance on another machine than the file's; None: that is not compared.
    """

    commands: tuple[str, ...]
    tolerance: float = 0.0
    loose: float | None = 1e-9
    slow: bool = False


CASES = {
    "decouple": Case(("decouple --out out",), 1e-9, 2e-2, slow=True),
    "compare": Case(("compare --out out",), 1e-9, 2e-2, slow=True),
    "compiled": Case(("compare --solver compiled --out out",), 1e-9, 2e-2, slow=True),
    "claims": Case(("claims --out nothing",), 1e-12),
    "explain": Case(("explain --out out",), 1e-6, 1e-6, slow=True),
    "statics": Case(("statics --out out",), 1e-12),
    "sweep": Case(
        (f"sweep --over control.gains.alpha=[0,0],[0.1,0.2] --controllers 1,2 {ONE_PERIOD} --out out",),
        1e-9,
        2e-2,
        slow=True,
    ),
    "ensemble": Case((f"ensemble {SMALL_ENSEMBLE} --out out",), 1e-9, None, slow=True),
    "config": Case(("config list", "config show compare", "config show decouple", "config check compare")),
    "diff": Case(
        (
            f"compare --controllers 1 {ONE_PERIOD} --out a",
            f"compare --controllers 1 {ONE_PERIOD} --set control.gains.lam.value=[6,6] --out b",
            "export a --format csv",
            "diff a b",
        ),
        1e-9,
        0.1,
        slow=True,
    ),
    "dataset": Case(("inspect record --suggest", "ingest record", "validate"), 1e-9, 2e-2, slow=True),
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if case.slow else []) for name, case in CASES.items()],
)
def test_answers_are_those_of_the_file(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, path = CASES[name], FOLDER / f"{name}.json"
    if not (AS_MADE or WRITE) and case.loose is None:
        pytest.skip("made on another machine; diverging runs end elsewhere here")
    monkeypatch.chdir(tmp_path)
    if name == "dataset":
        make_record(tmp_path / "record")
    found = [kept(answer(words)) for words in case.commands]
    if WRITE:
        path.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        MADE_ON.write_text(json.dumps(HERE, indent=1) + "\n", encoding="utf-8")
    expected = json.loads(path.read_text(encoding="utf-8"))
    assert not list(differences(expected, found, case.tolerance if AS_MADE else case.loose or 0.0))


def answer(words: str) -> Any:
    """JSON of one command."""
    done = CliRunner().invoke(
        app, [*shlex.split(words), "--json"], standalone_mode=False, catch_exceptions=False
    )
    return json.loads(done.stdout)


def kept(value: Any) -> Any:
    """The part of an answer that is compared."""
    if isinstance(value, dict):
        return {
            key: kept(part) for key, part in value.items() if not NOT_KEPT.fullmatch(key) and is_kept(part)
        }
    return [kept(part) for part in value if is_kept(part)] if isinstance(value, list) else value


def is_kept(value: Any) -> bool:
    if isinstance(value, str):
        return len(value.split()) < SENTENCE
    is_reading = isinstance(value, dict) and {"name", "share_c1_best"} <= value.keys()
    return not is_reading or value["name"] in KEPT_READINGS


def differences(expected: Any, found: Any, tolerance: float, where: str = "") -> Iterator[str]:
    """Places where what was found is not as expected; keys that are new are no difference."""
    if isinstance(expected, dict) and isinstance(found, dict):
        for key, part in expected.items():
            yield from differences(part, found.get(key, "missing"), tolerance, f"{where}.{key}")
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for place, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from differences(one, other, tolerance, f"{where}[{place}]")
    elif isinstance(expected, float) and isinstance(found, int | float):
        if not math.isclose(expected, found, rel_tol=tolerance, abs_tol=1e-3 * tolerance):
            yield f"{where}: {found}, not {expected}"
    elif expected != found:
        yield f"{where}: {found}, not {expected}"
