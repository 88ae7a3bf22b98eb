"""What every command answers, kept in files: a change of structure moves no digit.

Each case runs its commands in an empty folder and compares their ``--json`` with ``<case>.json`` beside this
file. Every number of an answer has to stand in the file, but for those that `LEFT_OUT` and `KEPT_READINGS`
name. Paths, versions, digests and sentences are no part of it.

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
from collections import Counter
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

LEFT_OUT = re.compile(
    "out|manifest|files?|size|text|conclusions|sources?|identity|created|md5|cost|resumed_from"
    "|blocks|.*(version|sha256|per_second|because|_at_s|^at_s)"
)
"""Keys that differ from run to run, or are files and words. None holds more than `FEW` numbers."""
FEW = 20
SENTENCE = 4
"""Words of a string that is not kept."""
KEPT_READINGS = {"printed", "weights=extrapolating", "gain_unit=phi_in_degrees"}
"""Of an ensemble, whose answer would be two megabytes."""
ONE_PERIOD = shlex.join(SHORT)
SMALL_ENSEMBLE = (
    "--draws 64 --jobs 2 --set block.value=16 --set scramblings.value=4 --set pairs=[] --set variations=[]"
)


@dataclass(frozen=True)
class Case:
    """Commands run one after the other, and how closely their numbers agree with the file.

    `loose` is the relative tolerance on another machine than the file's. None: there the file has to hold the
    same numbers of the same names, whatever their values, since diverging runs end elsewhere.
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
            "result export a --format csv",
            "result diff a b",
        ),
        1e-9,
        0.1,
        slow=True,
    ),
    "dataset": Case(("data inspect record --suggest", "ingest record", "validate"), 1e-9, 2e-2, slow=True),
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if case.slow else []) for name, case in CASES.items()],
)
def test_answers_are_those_of_the_file(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, path = CASES[name], FOLDER / f"{name}.json"
    monkeypatch.chdir(tmp_path)
    if name == "dataset":
        make_record(tmp_path / "record")
    answers = [answer(words) for words in case.commands]
    found = kept(answers)
    if WRITE:
        path.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        MADE_ON.write_text(json.dumps(HERE, indent=1) + "\n", encoding="utf-8")
    expected = json.loads(path.read_text(encoding="utf-8"))
    assert not {key: count for key, count in left_out(answers).items() if count > FEW}
    assert not set(numbers(found)) - set(numbers(expected))
    if AS_MADE or WRITE or case.loose is not None:
        assert not list(differences(expected, found, case.tolerance if AS_MADE else case.loose or 0.0))


@pytest.mark.parametrize("name", CASES)
def test_a_number_of_a_file_that_changes_by_a_hundredth_is_a_difference(name: str) -> None:
    expected, tolerance = (
        json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8")),
        CASES[name].tolerance,
    )
    # What is smaller is a zero with its rounding, as a force where two cancel.
    above_rounding = [number for number in numbers(expected).values() if abs(number) > 0.1 * tolerance]
    assert len(list(differences(expected, scaled(expected, 1.01), tolerance))) == len(above_rounding) > 0


def test_left_out_are_names_of_few_numbers() -> None:
    answer = {"blocks": 3, "populations": {"size": list(range(FEW + 1)), "share": 0.5}}
    assert left_out(answer) == {"blocks": 1, "size": FEW + 1}
    assert list(numbers(kept(answer))) == [("populations", "share")]


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
            key: kept(part) for key, part in value.items() if not LEFT_OUT.fullmatch(key) and is_kept(part)
        }
    return [kept(part) for part in value if is_kept(part)] if isinstance(value, list) else value


def is_kept(value: Any) -> bool:
    if isinstance(value, str):
        return len(value.split()) < SENTENCE
    is_reading = isinstance(value, dict) and {"name", "share_c1_best"} <= value.keys()
    return not is_reading or value["name"] in KEPT_READINGS


def numbers(value: Any, place: tuple[str | int, ...] = ()) -> dict[tuple[str | int, ...], float]:
    """All numbers of an answer, by their places."""
    if isinstance(value, dict | list):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        return {at: number for key, part in parts for at, number in numbers(part, (*place, key)).items()}
    return {place: value} if isinstance(value, int | float) and not isinstance(value, bool) else {}


def left_out(value: Any) -> Counter[str]:
    """How many numbers stand under each key that is left out."""
    count: Counter[str] = Counter()
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(key, str) and LEFT_OUT.fullmatch(key):
            count[key] += len(numbers(part))
        elif isinstance(part, dict | list) and is_kept(part):
            count += left_out(part)
    return count


def scaled(value: Any, factor: float) -> Any:
    """An answer with every number times `factor`."""
    if isinstance(value, dict):
        return {key: scaled(part, factor) for key, part in value.items()}
    if isinstance(value, list):
        return [scaled(part, factor) for part in value]
    return value * factor if isinstance(value, int | float) and not isinstance(value, bool) else value


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
