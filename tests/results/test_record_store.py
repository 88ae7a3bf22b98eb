"""A file of records: what is done comes back, what is cut off is not done, and what is damaged is named."""

from pathlib import Path

import numpy as np
import pytest

from tendonrepro.errors import DataMissingError
from tendonrepro.results.record_store import RecordStore, finished

KIND = np.dtype([("errors", np.float32, (2,)), ("status", np.int8)])


def records(count: int, first: int = 0) -> np.ndarray:
    made = np.zeros(count, KIND)
    made["errors"] = np.arange(first, first + count)[:, np.newaxis] + [0.0, 0.5]
    made["status"] = 1
    return made


def test_in_whatever_order_the_bytes_are_the_same(tmp_path: Path) -> None:
    whole = RecordStore(tmp_path / "whole.npy", KIND, 8)
    whole.put(range(8), records(8))
    broken = RecordStore(tmp_path / "broken.npy", KIND, 8)
    broken.put([6, 1], records(8)[[6, 1]])
    again = RecordStore(tmp_path / "broken.npy", KIND, 8)
    assert again.missing().tolist() == [0, 2, 3, 4, 5, 7]
    again.put(again.missing(), records(8)[again.missing()])
    assert (tmp_path / "whole.npy").read_bytes() == (tmp_path / "broken.npy").read_bytes()
    np.testing.assert_array_equal(again.read()["errors"], records(8)["errors"])


def test_a_record_that_was_cut_off_is_not_done(tmp_path: Path) -> None:
    """A kill in the middle of writing leaves the first bytes of a record."""
    path = tmp_path / "cut.npy"
    file = RecordStore(path, KIND, 4)
    file.put([0, 1, 2, 3], records(4))
    size = KIND.itemsize + 1
    image = path.read_bytes()
    for written in range(size):
        path.write_bytes(image[: -size + written] + bytes(size - written))
        assert RecordStore(path, KIND, 4).missing().tolist() == [3]


def test_more_pieces_take_up_the_records_of_fewer(tmp_path: Path) -> None:
    path = tmp_path / "grows.npy"
    RecordStore(path, KIND, 4).put([0, 1, 3], records(4)[[0, 1, 3]])
    more = RecordStore(path, KIND, 8)
    assert more.missing().tolist() == [2, 4, 5, 6, 7]
    more.put(more.missing(), records(8)[more.missing()])
    np.testing.assert_array_equal(RecordStore(path, KIND, 4).read()["errors"], records(4)["errors"])
    RecordStore(tmp_path / "whole.npy", KIND, 8).put(range(8), records(8))
    assert path.read_bytes() == (tmp_path / "whole.npy").read_bytes()


def test_what_is_not_done_cannot_be_read(tmp_path: Path) -> None:
    file = RecordStore(tmp_path / "open.npy", KIND, 2)
    file.put([1], records(1))
    with pytest.raises(DataMissingError):
        file.read()
    with pytest.raises(DataMissingError):
        finished(tmp_path / "open.npy", 3, "")


@pytest.mark.parametrize("harm", [lambda image: image[:-1], lambda _: b"text", lambda _: b""])
def test_a_damaged_file_is_named(tmp_path: Path, harm) -> None:
    path = tmp_path / "damaged.npy"
    RecordStore(path, KIND, 2).put([0, 1], records(2))
    path.write_bytes(harm(path.read_bytes()))
    for read in (lambda: RecordStore(path, KIND, 2), lambda: finished(path, 2, "")):
        with pytest.raises(DataMissingError) as caught:
            read()
        assert caught.value.where == str(path)


def test_records_of_another_kind_are_refused(tmp_path: Path) -> None:
    RecordStore(tmp_path / "file.npy", KIND, 2)
    with pytest.raises(DataMissingError):
        RecordStore(tmp_path / "file.npy", np.dtype([("other", np.int8)]), 2)
