"""Killed at any instant, an ensemble resumes to the identical result; a cluster gives it too."""

import multiprocessing
import os
import signal
import sys
import time

import numpy as np
import pytest
from support.fake_batch import finished_in, results, run_ensemble_of, run_small, slow_batch

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL and a fork server"),
]


@pytest.fixture(scope="module")
def context():
    """Processes that start with everything imported, so that kills hit the work and not the imports."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["support.fake_batch", "tendonrepro.monte_carlo.ensemble"])
    return context


def finished(process, seconds, folder=None, kept=0):
    """Wait so long, from the next record on where a folder is given, then kill; whether it ended before."""
    process.start()
    while folder and process.is_alive() and len(finished_in(folder)) <= kept:
        time.sleep(0.002)
    process.join(seconds)
    if process.exitcode is None:
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert process.exitcode in {0, -signal.SIGKILL}
    return process.exitcode == 0


@pytest.mark.parametrize(("jobs", "kills"), [(1, 50), (2, 4)])
def test_kills_at_random_instants_change_nothing(context, tmp_path, jobs, kills):
    run_small(tmp_path / "unbroken", 1)
    expected, records = results(tmp_path / "unbroken"), finished_in(tmp_path / "unbroken")
    # The first run starts the fork server as well; the second shows how long one takes.
    for name in ("first", "second"):
        started = time.monotonic()
        assert finished(context.Process(target=run_small, args=(tmp_path / name, jobs)), 300.0)
        whole = time.monotonic() - started
    assert results(tmp_path / "second") == expected
    rng = np.random.default_rng(11)
    done = resumed = 0
    while done < kills:
        folder = tmp_path / f"after_{done}"
        kept = 0
        # On a loaded machine most of a run is its start, so every other kill waits for the work to begin.
        while not finished(
            context.Process(target=run_small, args=(folder, jobs)),
            float(rng.uniform(0.0, 0.1 if done % 2 else 1.1 * whole)),
            folder if done % 2 else None,
            kept,
        ):
            done += 1
            # Whatever is there is whole, and nothing that was there is lost.
            whole_records = finished_in(folder)
            assert len(whole_records) >= kept
            assert whole_records.items() <= records.items()
            resumed += len(whole_records) > kept
            kept = len(whole_records)
        assert results(folder) == expected
    assert resumed > kills // 5, "the kills came too early to try anything"


def test_a_cluster_gives_the_same(tmp_path):
    distributed = pytest.importorskip("distributed")
    run_small(tmp_path / "unbroken", 1)
    folder = tmp_path / "cluster"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        run_ensemble_of(folder, dask=address, simulate=slow_batch)
    assert results(folder) == results(tmp_path / "unbroken")
