"""The command line; enter by `main`."""

from tendonrepro.cli.app import main

__all__ = ["main"]
