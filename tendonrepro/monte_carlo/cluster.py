"""Blocks computed on a dask.distributed cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import TypeVar

from tendonrepro.errors import TendonreproError, UsageError

Item = TypeVar("Item")
Result = TypeVar("Result")


def on_cluster(
    function: Callable[[Item], Result], items: Sequence[Item], address: str
) -> Generator[Result, None, None]:
    """Yield results as they become ready; a dying worker's items are given to another."""
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
    with client:
        try:
            waiting = client.map(function, items, pure=False, retries=2)
            for future in as_completed(waiting):  # type: ignore[no-untyped-call]
                yield future.result()
                future.release()
        except KilledWorker as error:
            message = "workers died again and again on the same block; finished blocks are kept"
            raise TendonreproError(message, where="--dask") from error
