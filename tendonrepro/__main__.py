"""``python -m tendonrepro`` is the command line."""

from __future__ import annotations

from tendonrepro.cli import main

main()
