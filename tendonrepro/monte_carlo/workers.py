"""Blocks computed side by side, on this machine or on a cluster, in whatever order they become ready."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from typing import TypeAlias, TypeVar

from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.monte_carlo.shards import Block
from tendonrepro.parallel import end_with_parent

Item = TypeVar("Item")
Result = TypeVar("Result")

MakeBlock: TypeAlias = Callable[[Block], tuple[Block, bytes]]
"""Makes the bytes of a block's shard; can be pickled."""


def here(make: Callable[[Item], Result], blocks: Sequence[Item], jobs: int) -> Generator[Result, None, None]:
    """Compute blocks, or other pieces of work, in processes of this machine, 1 being this one."""
    if jobs == 1 or len(blocks) < 2:
        yield from map(make, blocks)
        return
    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # From its start on a process ends with this one, even where this one is killed.
    begin = {"initializer": end_with_parent, "initargs": (os.getpid(),)}
    pool = Parallel(n_jobs=jobs, backend="loky", return_as="generator_unordered", batch_size=1, **begin)
    try:
        yield from pool(delayed(make)(block) for block in blocks)
    except TerminatedWorkerError as error:
        message = "a worker process died, perhaps for want of memory; finished blocks are kept"
        raise TendonreproError(message, hint="run it again with fewer --jobs") from error
    finally:
        # After an interrupt nobody waits for blocks that nobody will store.
        get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


def on_cluster(
    make: MakeBlock, blocks: Sequence[Block], address: str
) -> Generator[tuple[Block, bytes], None, None]:
    """Compute blocks on a dask.distributed cluster; what a dying worker had is given to another."""
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        message = "dask.distributed is not installed"
        raise UsageError(message, where="--dask", hint="pip install 'tendonrepro[dask]'") from error
    try:
        client = Client(address, timeout=10)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise TendonreproError(f"no scheduler answers at {address}", where="--dask") from error
    try:
        waiting = as_completed(  # type: ignore[no-untyped-call]
            client.map(make, blocks, pure=False, retries=2)
        )
        for future in waiting:
            yield future.result()
            future.release()
    except KilledWorker as error:
        message = "workers died again and again on the same block; finished blocks are kept"
        raise TendonreproError(message, where="--dask") from error
    finally:
        with suppress(OSError, TimeoutError):
            client.close()  # type: ignore[no-untyped-call]
