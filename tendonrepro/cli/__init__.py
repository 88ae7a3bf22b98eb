"""The command line; enter by `main`."""

from __future__ import annotations

import atexit
import gc
import json
import sys


def main() -> None:
    """Run the command line and leave with its exit code, also if interrupted before it can hear of it."""
    # What imports make stays. Looking it through for garbage time and again takes a twentieth of a command.
    gc.set_threshold(20_000, 50, 50)
    # What is left at the end dies with this process, which would look it through for 0.2 s.
    atexit.register(gc.freeze)
    try:
        from tendonrepro.cli.app import main as run

        run()
    except KeyboardInterrupt:
        # As the command line itself says it, which may not have been loaded yet.
        error = {"code": 130, "message": "interrupted", "where": None, "hint": None}
        if "--json" in sys.argv:
            sys.stdout.write(json.dumps({"error": error}) + "\n")
        else:
            sys.stderr.write("error: interrupted\n")
        sys.exit(130)


__all__ = ["main"]
