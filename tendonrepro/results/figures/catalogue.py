"""The paper's figures: which there are, what each needs, and how one is drawn from traces and saved."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.figures.compare import (
    MEAN_WINDOW,
    RIPPLE_WINDOW,
    ZOOM,
    controllers,
    draw_law,
    draw_motors,
    draw_payload,
    draw_tracking,
)
from tendonrepro.results.figures.decouple import draw_joint, draw_motor_angles, draw_pull
from tendonrepro.results.figures.panels import Canvas, FigureArtists
from tendonrepro.results.figures.style import journal_style, save_figure
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import fitted_under

_LONGEST_CHANGES = 60
_ERRORS = "Where errors are of the size of encoder counts, their mean in a band of the RMS about it."


@dataclass(frozen=True)
class FigureSpec:
    """What a figure shows and needs.

    `runs` picks its runs out of a trace file, of which those are drawn that hold all `joints` and ``all`` of
    the variables it `needs`, or ``any``, as `enough` says; the plant record must hold the values of `plant`.
    """

    caption: str
    experiment: str
    runs: Callable[[TraceFile], list[Trace]]
    needs: tuple[str, ...]
    draw: Callable[[TraceFile, list[Trace]], Canvas]
    enough: Callable[[Iterable[bool]], bool] = all
    plant: tuple[str, ...] = ()
    joints: tuple[int, ...] = ()

    def traces(self, file: TraceFile) -> list[Trace]:
        """Pick the runs of a file that can be drawn; there are none when the figure cannot be."""
        if not set(self.plant) <= set(file.plant.values):
            return []
        return [
            trace
            for trace in self.runs(file.part(self.experiment))
            if self.enough(name in trace for name in self.needs) and set(self.joints) <= set(trace.joint)
        ]


def available(file: TraceFile) -> list[int]:
    """Numbers of the paper's figures that can be drawn from a trace file, ascending."""
    return [number for number, spec in FIGURES.items() if spec.traces(file)]


def draw(number: int, file: TraceFile) -> FigureArtists:
    """Draw one figure by the paper's number."""
    if number not in FIGURES:
        message = f"there is no Figure {number} to draw"
        raise UsageError(message, hint=f"Figures: {', '.join(map(str, FIGURES))}.")
    spec = FIGURES[number]
    traces = spec.traces(file)
    if not traces:
        message = f"these {file.experiment} traces do not hold what Figure {number} shows"
        drawable = ", ".join(map(str, available(file))) or "none"
        raise DataMissingError(message, hint=f"Figures that can be drawn from them: {drawable}.")
    with journal_style():
        return spec.draw(file, traces).finish(number, _caption(number, spec, file, traces), origin_of(file))


def save(artists: FigureArtists, folder: Path) -> list[Path]:
    """Write a figure as ``figNN.pdf``, ``figNN.svg`` and ``figNN.png``; the same figure gives the same bytes.

    Raises
    ------
    TendonreproError
        When a file cannot be written.
    """
    return save_figure(artists.figure, folder, artists.stem, f"Figure {artists.number}", artists.caption)


def redrawn(file: TraceFile, folder: Path, number: int) -> list[Path]:
    """Draw and save one figure; see `draw` and `save`."""
    return save(draw(number, file), folder)


def origin_of(file: TraceFile) -> str:
    """One line for a picture: simulated or measured, and by which configuration with which changes."""
    if file.source == "measured":
        return "Measured"
    try:
        manifest = json.loads(file.manifest_json)
        name = Path(str(manifest["config"]["origin"])).name
        changes = list(map(str, manifest.get("overrides", ())))
    except (ValueError, LookupError, TypeError):
        name, changes = file.experiment, []
    if sum(map(len, changes)) > _LONGEST_CHANGES:
        changes = [f"{len(changes)} settings changed"]
    if under := fitted_under(file):
        changes.append(f"fitted to the print under {under}")
    return f"Simulated, configuration {', '.join([name, *changes])} ({file.config_sha256[:8]})"


def _caption(number: int, spec: FigureSpec, file: TraceFile, traces: list[Trace]) -> str:
    made = "Simulated" if file.source == "simulated" else "Measured"
    ends = [
        f"Run {trace.name} {trace.status} at {trace.attributes['status_time']:.2f} s."
        for trace in traces
        if trace.status == "diverged"
    ]
    ends += [f"Run {trace.name} is ringing." for trace in traces if trace.status == "ringing"]
    origin = f"{made}; tendonrepro {file.tendonrepro_version}, configuration {file.config_sha256[:12]}."
    return " ".join([f"Figure {number}. {spec.caption}", *ends, origin])


def _named(*names: str) -> Callable[[TraceFile], list[Trace]]:
    return lambda file: [file.runs[name] for name in names if name in file.runs]


FIGURES: dict[int, FigureSpec] = {
    6: FigureSpec(
        "Motor 1 turns alone, motors 2 and 3 hold: joint 2 moves all the same. Postures at the start and "
        "where joint 1 turned furthest, by the encoders.",
        "decouple",
        _named("pull_tendon_1"),
        ("q_motor_encoder", "q_encoder"),
        draw_pull,
        plant=("S",),
        joints=(1, 2),
    ),
    9: FigureSpec(
        "Angles of the three motors.",
        "decouple",
        _named("decouple"),
        ("q_motor_encoder",),
        draw_motor_angles,
    ),
    **{
        9 + joint: FigureSpec(
            f"Angle of joint {joint} calculated from the motors and by its encoder; their difference.",
            "decouple",
            _named("decouple"),
            ("q_calculated", "q_encoder"),
            partial(draw_joint, joint=joint),
            joints=(joint,),
        )
        for joint in (1, 2, 3)
    },
    13: FigureSpec(
        "Motor angles from measured and from desired joint angles, through S_inv; their difference. "
        "The paper does not say with which controller: here Controller 1.",
        "compare",
        _named("controller_1"),
        ("q_encoder", "q_d"),
        draw_motors,
        plant=("S_inv",),
    ),
    14: FigureSpec(
        f"Joint angles and tracking errors of the controllers; MAE in the order of the legend. {_ERRORS}",
        "compare",
        controllers,
        ("q_encoder", "e"),
        draw_tracking,
        enough=any,
    ),
    15: FigureSpec(
        "Sliding variable, estimate of the lumped uncertainty and torque of the controllers: "
        f"centred {MEAN_WINDOW * 1e3:g} ms mean, in bands of the RMS of the samples about it over "
        f"{RIPPLE_WINDOW:g} s; below raw samples of {ZOOM * 1e3:g} ms, at the grey line.",
        "compare",
        controllers,
        ("s", "H_hat", "tau_m"),
        draw_law,
        enough=any,
    ),
    16: FigureSpec(
        "Controller 1 without and with a payload at the end-effector: joint angles and tracking errors; "
        f"MAE in the order of the legend. {_ERRORS}",
        "compare",
        _named("controller_1", "controller_1_payload"),
        ("q_encoder", "e"),
        draw_payload,
        enough=any,
    ),
}
"""Every figure that can be drawn, by the paper's number."""
