"""The real record of the paper, for those who have a network: pytest -m network."""

from __future__ import annotations

from pathlib import Path

import pytest

from tendonrepro.console import Talk
from tendonrepro.dataset.repository.download import download
from tendonrepro.dataset.repository.fetch import expected_files, resolve
from tendonrepro.dataset.repository.lock import find_differences
from tendonrepro.dataset.repository.web import Patience, Web
from tendonrepro.dataset.repository.zenodo import SITE


@pytest.mark.network
def test_the_paper_s_record_and_its_smallest_file(tmp_path: Path) -> None:
    web = Web(Talk(), Patience())
    record = resolve(web, SITE, "19467931", print)
    assert record.title
    expected = {file.key: file for file in expected_files(record)}
    smallest = min(record.files, key=lambda file: file.size)
    download(web, record.record_id, smallest, tmp_path / expected[smallest.key].path, lambda _: None)
    assert find_differences([expected[smallest.key]], tmp_path) == ([], [])
