"""Blocks computed on a dask.distributed cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.parallel import Item, Result


def on_cluster(
    function: Callable[[Item], Result], items: Sequence[Item], address: str
) -> Generator[Result, None, None]:
    """Yield results as they become ready; a dying worker's items are given to another."""
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        hint = "pip install 'tendonrepro[dask]'"
        raise UsageError("dask.distributed is not installed", where="--dask", hint=hint) from error
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
