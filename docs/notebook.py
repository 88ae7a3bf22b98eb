"""Run the notebook of examples, and keep what its cells show: ``make notebook``."""

from __future__ import annotations

from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parent.parent / "examples" / "notebook.ipynb"

if __name__ == "__main__":
    held = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(held, timeout=600, kernel_name="python3", record_timing=False).execute()
    # The version of Python that ran it changes nothing.
    held.metadata["language_info"] = {"name": "python"}
    nbformat.write(held, NOTEBOOK)
