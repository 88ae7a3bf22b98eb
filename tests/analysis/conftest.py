"""A coarse map of stability: its borders are found by halving, wherever the grid lies."""

from collections.abc import Iterator

import pytest

from tendonrepro.analysis import margins


@pytest.fixture(scope="package", autouse=True)
def _coarse_map() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(margins, "MAP_POINTS", 5)
        yield
