"""Which rows of the box the printed numbers feel.

On the best of some draws, each row in turn is put at its nominal value. A row that hardly changes the numbers
there can be held at that value; each row that is searched costs experiments.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.config.models.readings import Reading
from tendonrepro.ensemble.box import Box, scrambled_sobol
from tendonrepro.identify.misfit import Bench, log_misfit, log_residuals

DRAWS, LOOKED_AT = 256, 8

FELT = 0.1
"""Root mean square change in log of the numbers, over plants and numbers, from which on a row is searched.

A choice: what moves them by less than a tenth the others make good, down to misfits well below that.
"""

_SWITCHES = {
    "reducer_loss_acts": {"reducer_efficiency"},
    "disturbance": {"disturbance_torque", "disturbance_frequency"},
}
"""What a row switches where its name does not say it."""


def rows_that_matter(
    bench: Bench, case: Reading, runs: Sequence[str], printed: Array, seed: int
) -> NDArray[np.bool_]:
    """Rows of the bench's box to search under a reading, (P,); all where none is felt.

    Parameters
    ----------
    bench : Bench
    case : Reading
    runs : sequence of str
        Those whose numbers are fitted.
    printed : array (R, 2, n)
        Their printed numbers, deg.
    seed : int
        Of the draws.
    """
    box = bench.box
    draws = scrambled_sobol(box, seed, 0, 0, DRAWS)
    measured = bench.measure(draws, case, runs)
    best = np.argsort(log_misfit(measured, printed), kind="stable")[:LOOKED_AT]
    before = log_residuals(measured, printed)[best]
    rows = np.arange(len(box.names))
    moved = np.repeat(draws[best, np.newaxis], rows.size, axis=1)
    moved[:, rows, rows] = nominal_unit(box)
    after = log_residuals(bench.measure(moved.reshape(-1, rows.size), case, runs), printed)
    change = after.reshape(LOOKED_AT, rows.size, -1) - before.reshape(LOOKED_AT, 1, -1)
    felt = with_switches(box.names, np.sqrt(np.mean(change**2, axis=(0, 2))) >= FELT)
    return felt if felt.any() else np.ones_like(felt)


def with_switches(names: Sequence[str], chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows together with those without which they do nothing where these are nominal."""
    sizes = {name for name, is_chosen in zip(names, chosen, strict=True) if is_chosen}
    switches = [not sizes.isdisjoint(_SWITCHES.get(name, {name.removesuffix("_acts")})) for name in names]
    return chosen | np.array(switches, dtype=np.bool_)


def nominal_unit(box: Box) -> Array:
    """Point of the unit cube at which every row has its nominal value, (P,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(box.nominal / box.low) / np.log(box.high / box.low)
        shares = (box.nominal - box.low) / (box.high - box.low)
    unit = np.where(np.array(box.scale) == "log", logs, shares)
    for row, choices in enumerate(box.choices):
        if choices.size:
            unit[row] = (int(np.argmin(np.abs(choices - box.nominal[row]))) + 0.5) / choices.size
    return unit
