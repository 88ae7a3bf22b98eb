"""The scripts of the benchmark folder as modules."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import pytest
from support import ROOT


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


@pytest.fixture
def bench(scripts: None) -> ModuleType:  # noqa: ARG001
    return import_module("bench")


@pytest.fixture
def against(scripts: None) -> ModuleType:  # noqa: ARG001
    return import_module("against")


@pytest.fixture
def batch(scripts: None) -> ModuleType:  # noqa: ARG001
    return import_module("bench_batch")


@pytest.fixture
def baseline(scripts: None) -> ModuleType:  # noqa: ARG001
    return import_module("baseline_solve_ivp")


@pytest.fixture
def compiled(scripts: None) -> ModuleType:  # noqa: ARG001
    return import_module("baseline_numba")


@pytest.fixture
def recovery(scripts: None) -> ModuleType:  # noqa: ARG001
    return import_module("recovery")
