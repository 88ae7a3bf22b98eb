"""The command line; enter by `main`."""

from __future__ import annotations

import gc


def main() -> None:
    """Run the command line and leave with its exit code."""
    # What imports make stays. Looking it through for garbage time and again takes a twentieth of a command.
    gc.set_threshold(20_000, 50, 50)
    try:
        from tendonrepro.cli.app import main as run

        run()
    finally:
        # What is left ends with this process, which would look it through for 0.2 s.
        gc.freeze()


__all__ = ["main"]
