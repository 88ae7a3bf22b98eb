"""From a stored run to a film or to single pictures of the arm in motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.results.scene import Scene, scene_of
from tendonrepro.results.store import refuse_existing, stored_traces

RATE = 10
"""Pictures per second of a film."""

MOST_PICTURES = 1500
"""Of a film: two and a half minutes, which take half a gigabyte to make."""


def animate(
    source: Path,
    talk: Talk,
    *,
    run: str | None = None,
    times: Sequence[float] = (),
    speed: float = 1.0,
    out: Path | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Draw the arm of a stored run with its tendons by tension, beside two plots.

    Parameters
    ----------
    source : Path
        Trace file, or a results folder that holds one.
    talk : Talk
    run : str, optional
        Name of a run; the first one if not given.
    times : sequence of float
        Single pictures at these times, s, as SVG, instead of a film.
    speed : float
        Seconds of the run in one second of the film.
    out : Path, optional
        File to write, a film ``.gif`` or ``.mp4``; else beside the traces, with the name of the run. Of
        several pictures each has its time in its name.
    force : bool
        Overwrite files that are there.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    UsageError
        For options that do not fit each other or the run, a file that is there, an MP4 without ffmpeg.
    DataMissingError
        If the traces cannot be read or do not say where the joints are.
    """
    if not 0.0 < speed < np.inf:
        message = f"must be above zero, found {speed:g}"
        raise UsageError(message, where="--speed")
    file = stored_traces(source)
    scene = scene_of(file, run)
    times = list(dict.fromkeys(times))
    folder = source if source.is_dir() else source.parent
    target = out or folder / f"{scene.name}{'.svg' if times else '.gif'}"
    places = _places(scene, times) if times else _film_places(scene, speed)
    files = _targets(target, times)
    for one in files:
        refuse_existing(one, force=force)

    from tendonrepro.results.figures.animation import save_film, save_frames
    from tendonrepro.results.figures.catalogue import origin_of

    if times:
        save_frames(scene, origin_of(file), dict(zip(files, places, strict=True)))
    else:
        with talk.bar(f"{scene.name}: pictures", len(places)) as advance:
            save_film(scene, origin_of(file), target, places, RATE, advance)
    names = [str(one) for one in files]
    return {"schema_version": 1, "files": names, "run": scene.name, "pictures": len(places)}


def _film_places(scene: Scene, speed: float) -> list[int]:
    """Samples at equal steps of time, the last one before each."""
    count = (scene.time[-1] - scene.time[0]) / speed * RATE
    if count > MOST_PICTURES:
        message = f"the film would have {count:.3g} pictures, more than {MOST_PICTURES}"
        raise UsageError(
            message, where="--speed", hint=f"from --speed {speed * count / MOST_PICTURES * 1.05:.2g} on"
        )
    wanted = scene.time[0] + np.arange(int(count) + 1) * speed / RATE
    return _at(scene, wanted)


def _places(scene: Scene, times: Sequence[float]) -> list[int]:
    first, last = scene.time[0], scene.time[-1]
    for time in times:
        if not first <= time <= last:
            message = f"the run {scene.name} goes from {first:g} to {last:g} s, found {time:g}"
            raise UsageError(message, where="--at")
    return _at(scene, np.array(times))


def _at(scene: Scene, wanted: Any) -> list[int]:
    """Last sample at or before each time; a millionth of a sample is rounding."""
    late = wanted + 1e-6 * np.diff(scene.time).min(initial=1.0)
    return [int(place) - 1 for place in np.searchsorted(scene.time, late, side="right")]


def _targets(target: Path, times: Sequence[float]) -> list[Path]:
    """Check the suffix, and give the file of each picture its time where there are several."""
    fitting = (".svg",) if times else (".gif", ".mp4")
    if target.suffix not in fitting:
        what = "single pictures are" if times else "a film is"
        message = f"{what} {' or '.join(fitting)}, found {target.name!r}"
        hint = None if times else "single pictures come with --at SECONDS"
        raise UsageError(message, where="--out", hint=hint)
    if len(times) < 2:
        return [target]
    return [target.with_stem(f"{target.stem}_{time:g}s") for time in times]


def animate_text(found: dict[str, Any]) -> str:
    """Files, one a line."""
    return "\n".join(found["files"])
