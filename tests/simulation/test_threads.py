"""Threads of a GPU give what lanes give. Their source is compiled as C++ here: no GPU is needed."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.host_device import COMPILER, Host

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import case_of, parse_reading
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.monte_carlo.box import scrambled_sobol
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.monte_carlo.plants import drawn_loops
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation import batch, crowd, device
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import Loop

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no g++ on the path")

NEAR = 1e-9
"""Difference of errors that the same operations make in another order, rad."""

LIMITS = load_config(None, "compare").config.status


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Host:
    found = Host(tmp_path)
    monkeypatch.setattr(batch, "graphics", lambda: found)
    return found


def short(loop: Loop, samples: int) -> Loop:
    held = loop.reference
    cut = {name: getattr(held, name)[:samples] for name in ("time", "q_d", "dq_d", "ddq_d")}
    return replace(loop, reference=replace(held, **cut))


def shipped(*overrides: str, samples: int = 10**9) -> list[Loop]:
    return [
        short(loop, samples) for loop in all_loops(load_config(None, "compare", overrides=overrides)).values()
    ]


def assert_near(found: Batch, expected: Batch, kept: Any = slice(None)) -> None:
    """Errors within `NEAR`, everything else relative to its size."""
    for name in ("mae", "rmse", "max_error", "overshoot", "mae_late", "mae_settled", "rmse_rapid"):
        if name in expected.statistics:
            np.testing.assert_allclose(
                found.statistics[name][kept], expected.statistics[name][kept], rtol=0.0, atol=NEAR
            )
    for name, values in expected.statistics.items():
        size = np.nanmax(np.abs(values[kept]), initial=1e-12)
        np.testing.assert_allclose(found.statistics[name][kept], values[kept], rtol=1e-6, atol=1e-6 * size)


@needs_compiler
def test_runs_of_every_kind_end_as_on_lanes(host: Host) -> None:
    """Noise, a disturbance, a delay; the second set diverges at once, and the third is of other laws."""
    noisy = shipped(
        "manipulator.actuator.torque_noise.value=0.1",
        "manipulator.actuator.output_delay.value=1",
        "manipulator.encoders.joint.resolution.value=0",
        samples=2500,
    )
    wild = shipped("status.divergence_limit.value=0.05", samples=1500)
    loops = [*noisy, *wild, *shipped("control.readings.delay_time=two_periods", samples=1500)]
    found, expected = simulate_batch(loops, LIMITS, device="gpu"), simulate_batch(loops, LIMITS)
    assert (found.status == expected.status).all()
    assert STATUSES.index("diverged") in found.status
    assert (found.status_time == expected.status_time).all()
    assert (found.steps == expected.steps).all()
    assert_near(found, expected, slice(0, 4))
    assert len(host.sources) < len(loops)  # runs share code


@needs_compiler
def test_what_the_memory_does_not_hold_runs_in_parts(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    loops = shipped(samples=40) * 5
    whole = simulate_batch(loops, LIMITS, device="gpu")
    host.most, host.launched = 6, []
    monkeypatch.setattr(crowd, "FEWEST", 4)
    parts = simulate_batch(loops, LIMITS, device="gpu")
    assert sum(host.launched) == len(loops)
    assert max(host.launched) <= 6
    for name, values in whole.statistics.items():
        np.testing.assert_array_equal(parts.statistics[name], values)
    host.most = 2
    with pytest.raises(TendonreproError):
        simulate_batch(loops, LIMITS, device="gpu")


@pytest.mark.slow
@needs_compiler
@pytest.mark.usefixtures("host")
@pytest.mark.parametrize(("readings", "edges"), [("encoder=ideal", 0), ("default", 2)])
def test_draws_of_the_box_end_as_on_lanes(readings: str, edges: int) -> None:
    """With encoder steps a run may part from another by rounding alone: statuses differ at edges only."""
    study = load_study(None, (), None, readings)
    box = study.boxes["box"]
    ideal = readings != "default"
    cases = [case for case in study.cases if "encoder=ideal" in case[1].name] if ideal else study.cases[::3]
    values = box.values(scrambled_sobol(box, 5, 0, 0, 16 if ideal else 2))
    loops = [*chain.from_iterable(drawn_loops(study.loaded.base, box, values, cases))]
    found, expected = simulate_batch(loops, LIMITS, device="gpu"), simulate_batch(loops, LIMITS)
    assert (found.status != expected.status).sum() <= edges
    if ideal:
        assert_near(found, expected, (found.status == expected.status) & (found.status == 0))


def test_every_reading_has_a_source_without_what_a_gpu_lacks() -> None:
    """A name that is neither a variable nor a function of CUDA would fail in the driver's compiler."""
    reading = case_of(parse_reading("feedback=motor+delay_time=two_periods"), "controller_1")
    study = load_study(None, (), None, reading.name)
    box = study.boxes["box"]
    (loops,) = drawn_loops(study.loaded.base, box, box.nominal[np.newaxis], study.cases)
    sources: set[str] = set()
    spy = SimpleNamespace(compiled=sources.add)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "graphics", lambda: spy)
        patch.setattr(batch, "run_crowd", lambda *_: [])
        simulate_batch(loops, LIMITS, device="gpu")
    assert sources
    for source in sources:
        assert "np." not in source
        assert "pow(" not in source  # powers are arithmetic, as on lanes


def test_without_cupy_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cupy", None)
    device.graphics.cache_clear()
    with pytest.raises(UsageError) as refused:
        simulate_batch(shipped(samples=5), LIMITS, device="gpu")
    assert "tendonrepro[gpu]" in str(refused.value.hint)


class _Failure(RuntimeError):
    pass


def fake_cupy(host: Host, devices: int = 1, broken: bool = False) -> Any:
    """What is used of CuPy, on a processor."""

    def count() -> int:
        if devices < 0:
            raise _Failure("cudaErrorInsufficientDriver: CUDA driver version is insufficient")
        return devices

    class RawKernel:
        def __init__(self, source: str, name: str) -> None:
            self._source, self._name = source, name

        def compile(self) -> None:
            if broken:
                raise _Failure("error: identifier is undefined\nmore")
            self._run = host.compiled(self._source)

        def __call__(self, grid: tuple[int], threads: tuple[int], arguments: tuple[Any, ...]) -> None:
            lanes = int(arguments[3])
            assert grid[0] * threads[0] >= lanes > (grid[0] - 1) * threads[0]
            host.launch(self._run, lanes, arguments)

    runtime = SimpleNamespace(CUDARuntimeError=_Failure, getDeviceCount=count, deviceSynchronize=lambda: None)
    cuda = SimpleNamespace(
        runtime=runtime,
        driver=SimpleNamespace(CUDADriverError=_Failure),
        compiler=SimpleNamespace(CompileException=_Failure),
    )
    return SimpleNamespace(
        cuda=cuda, RawKernel=RawKernel, asarray=np.ascontiguousarray, zeros=np.zeros, asnumpy=np.array
    )


@needs_compiler
def test_what_cupy_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loops = shipped(samples=30)
    gpu = device.Graphics(fake_cupy(Host(tmp_path)))
    monkeypatch.setattr(batch, "graphics", lambda: gpu)
    found, expected = simulate_batch(loops, LIMITS, device="gpu"), simulate_batch(loops, LIMITS)
    assert (found.status == expected.status).all()
    np.testing.assert_allclose(found.statistics["mae"], expected.statistics["mae"], atol=1e-12)


def test_no_gpu_and_a_kernel_that_does_not_compile_are_sentences(tmp_path: Path) -> None:
    for devices in (0, -1):
        with pytest.raises(TendonreproError):
            device.Graphics(fake_cupy(Host(tmp_path), devices))
    with pytest.raises(TendonreproError) as refused:
        device.Graphics(fake_cupy(Host(tmp_path), broken=True)).compiled("source")
    assert "\n" not in refused.value.message
