"""Where a search stands, in memory and on disk."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.console import Talk
from tendonrepro.files import write_atomically


@dataclass(frozen=True)
class State:
    """Where a search stands.

    Attributes
    ----------
    generation : int
        Generations done.
    units : array (S, M, P)
        Members of each seed's population in the unit cube.
    misfits : array (S, M)
    residuals : array (S, M, K)
    spread_units, spread_misfits : array
        The same at the end of the first phase, or so far.
    history : array (generation + 1, S)
        Best misfit.
    random : tuple of str
        State of each seed's generator, as JSON.
    """

    generation: int
    units: Array
    misfits: Array
    residuals: Array
    spread_units: Array
    spread_misfits: Array
    history: Array
    random: tuple[str, ...]

    def best(self) -> tuple[Array, float]:
        """Best point (P,) and its misfit."""
        seed, member = np.unravel_index(int(np.argmin(self.misfits)), self.misfits.shape)
        return self.units[seed, member], float(self.misfits[seed, member])

    def near(self, limit: float) -> Array:
        """Members of the first phase's last population with a misfit up to a limit, (N, P)."""
        return self.spread_units[self.spread_misfits <= limit]


_ARRAYS = ("units", "misfits", "residuals", "spread_units", "spread_misfits", "history")


def save_state(path: Path, state: State, identity: str) -> None:
    """Store a state, whole or not at all.

    Parameters
    ----------
    path : Path
    state : State
    identity : str

    Raises
    ------
    TendonreproError
        When it cannot be written.
    """
    stream = io.BytesIO()
    content: dict[str, Any] = {name: getattr(state, name) for name in (*_ARRAYS, "generation", "random")}
    np.savez(stream, allow_pickle=False, identity=identity, **content)
    write_atomically(path, stream.getvalue())


def load_state(path: Path, identity: str, talk: Talk) -> State | None:
    """Read a state.

    Parameters
    ----------
    path : Path
    identity : str
    talk : Talk
        Hears when a file is damaged or of another search.

    Returns
    -------
    State or None
        None when there is none to go on from.
    """
    if not path.exists():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
            if str(stored["identity"]) == identity:
                arrays = {name: stored[name] for name in _ARRAYS}
                random = tuple(map(str, stored["random"]))
                return State(generation=int(stored["generation"]), random=random, **arrays)
        reason = "is of another search"
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        reason = "is damaged"
    talk.note(f"{path} {reason}; the search starts anew")
    return None
