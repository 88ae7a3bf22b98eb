"""The command line: parse, call one function, print."""

from tendonrepro.cli.app import main

__all__ = ["main"]
