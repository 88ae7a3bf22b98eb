"""What made a result: configuration, versions, machine, and digests of inputs and outputs."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from tendonrepro import __version__
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.files import sha256_of

LIBRARIES = ("numpy", "scipy", "llvmlite", "h5py", "matplotlib", "pandas", "pydantic", "pyyaml", "typer")


def make_manifest(loaded: LoadedConfig, seconds: float, command: str | None = None) -> dict[str, Any]:
    """How a result came about, for JSON; what is unknown is None. `seconds` is the wall time."""
    config = loaded.config
    return {
        "schema_version": 1,
        "tendonrepro_version": __version__,
        "experiment": config.experiment,
        "command": command or config.experiment,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "config": {"origin": loaded.origin, "sha256": loaded.sha256, "tree": loaded.tree},
        "overrides": list(loaded.overrides),
        "seed": int(config.seed.si),
        "solver": {
            "name": f"scipy.integrate.ode {config.solver.method}"
            + (", its steps compiled" if config.solver.method == "dop853" else ""),
            "rtol": config.solver.rtol.si,
            "atol": config.solver.atol.si,
            "max_step_s": config.solver.max_step.si,
        },
        "wall_time_s": round(seconds, 3),
        "environment": environment(),
        "inputs": {str(path): sha256_of(path) for path in loaded.inputs},
    }


def environment() -> dict[str, Any]:
    """Python, machine, library versions and the state of the checkout, if this is one."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu": cpu_name(),
        "cpu_count": os.cpu_count(),
        "versions": {name: metadata.version(name) for name in LIBRARIES},
        "git": git_state(),
    }


def cpu_name() -> str | None:
    """Model name of the processor."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(names), platform.processor() or None)


def git_state() -> dict[str, Any] | None:
    """Commit of the checkout the package runs from, and whether it has been changed; None elsewhere."""
    folder = Path(__file__).resolve().parent

    def git(*words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        # A package installed inside some other project's checkout is not that project's.
        git("ls-files", "--error-unmatch", Path(__file__).name)
        return {"commit": git("rev-parse", "HEAD"), "dirty": bool(git("status", "--porcelain"))}
    except (OSError, subprocess.SubprocessError):
        return None
