"""Every figure drawn from traces: what it shows, what it needs, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from tendonrepro.configuration.models.control import FIRST, LOADED
from tendonrepro.configuration.models.manipulator import MOST_JOINTS
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.figures import paper_figures as paper
from tendonrepro.results.figures.style import Drawing, Sheet, journal_style, title_of
from tendonrepro.results.paper import of_paper, origin_of
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import compared_runs

_ERRORS = (
    "Where an error is of the size of encoder steps, all errors are drawn as a centred "
    f"{paper.MEAN_WINDOW * 1e3:g} ms mean, in a band of the RMS of the samples about it."
)


@dataclass(frozen=True)
class FigureSpec:
    """What a figure shows and needs.

    Of its `runs`, by default the comparison's without payload, those are drawn that hold all `joints` and all
    variables it `needs`, or `some`. The plant record must hold `plant`. What is said `of_paper` ends
    the caption where the arm is the paper's.
    """

    draw: Callable[[TraceFile, list[Trace]], Sheet]
    caption: str
    needs: tuple[str, ...]
    runs: tuple[str, ...] = ()
    some: bool = False
    plant: tuple[str, ...] = ()
    joints: tuple[int, ...] = ()
    of_paper: str = ""

    def traces(self, file: TraceFile) -> list[Trace]:
        """Runs of a file that can be drawn; none when the figure cannot be."""
        names = self.runs or compared_runs(file.part("compare"))
        enough = any if self.some else all
        return [
            trace
            for trace in (file.runs[name] for name in names if name in file.runs)
            if enough(variable in trace for variable in self.needs)
            and set(self.joints) <= set(trace.joint)
            and set(self.plant) <= set(file.plant.values)
        ]


def name_of(figure: str | int) -> str:
    """Name of a figure by name or number in the paper; a UsageError where there is none."""
    name = f"fig{int(figure):02d}" if str(figure).isdecimal() else str(figure)
    if name not in FIGURES:
        message = f"there is no figure {figure}"
        raise UsageError(message, hint=f"figures: {', '.join(FIGURES)}")
    return name


def drawings(file: TraceFile) -> dict[str, Callable[[], Drawing]]:
    """How to draw each figure that a trace file allows, from the runs that it shows alone."""
    return {
        name: partial(draw, name, replace(file, runs={trace.name: trace for trace in traces}))
        for name, spec in FIGURES.items()
        if (traces := spec.traces(file))
    }


def draw(figure: str | int, file: TraceFile) -> Drawing:
    """Draw a figure by name or number; a DataMissingError where the file does not hold what it shows."""
    name = name_of(figure)
    spec = FIGURES[name]
    traces = spec.traces(file)
    if not traces:
        message = f"these {file.experiment} traces do not hold what {title_of(name)} shows"
        raise DataMissingError(message, hint=f"figures they allow: {', '.join(drawings(file)) or 'none'}")
    with journal_style():
        sheet = spec.draw(file, traces)
        caption = caption_of(name, file, sheet, f"{file.source.capitalize()}, {runs_of(traces)}")
        return sheet.finish(name, caption, origin_of(file))


def caption_of(name: str, file: TraceFile, sheet: Sheet, made: str) -> str:
    """Caption of a figure on its sheet: what it shows, how that was `made`, and the window of time."""
    windows = " and ".join(f"{start:.4g} to {end:.4g} s" for start, end in sheet.windows)
    title = [f"{title_of(name)}."] if title_of(name) != name else []
    spec = FIGURES[name]
    beside = [spec.of_paper] if spec.of_paper and of_paper(file) else []
    if {"e", "q_encoder"} & {*spec.needs} and any(trace.of_motors for trace in spec.traces(file)):
        beside.append("Angles and errors are of the motors, at whose encoders the law looks.")
    told = [sheet.told] if sheet.told else []
    return " ".join([*title, spec.caption, *told, *beside, f"{made}, {windows}."])


def runs_of(traces: list[Trace]) -> str:
    """Names of runs, with the status of those that are not ok."""
    names = [
        trace.name if trace.status == "ok" else f"{trace.name} ({trace.told_status})" for trace in traces
    ]
    return f"run{'s' if len(names) > 1 else ''} {', '.join(names)}"


FIGURES: dict[str, FigureSpec] = {
    "fig06": FigureSpec(
        paper.draw_pull,
        "Motor 1 turns alone, the others hold: the arm with its tendons at the start and when motor 1 has "
        "turned farthest, and the angles on the way. Joint 2 moves all the same.",
        ("q_motor_encoder", "q_encoder"),
        ("pull_tendon_1",),
        plant=("S", "length", "posture"),
        joints=(1, 2),
        of_paper="By the printed coupling joint 2 turns as joint 1. Section 3.1 says the opposite way: link "
        "2 would lie on the dashed line.",
    ),
    "fig09": FigureSpec(
        paper.draw_motor_angles,
        "Angles of the motors.",
        ("q_motor_encoder",),
        ("decouple",),
    ),
    **{
        f"fig{9 + joint:02d}" if joint <= 3 else f"joint_{joint}": FigureSpec(
            partial(paper.draw_joint, joint=joint),
            f"Angle of joint {joint} calculated from the motors and by its encoder; their difference, whose "
            "steps are those of the encoder.",
            ("q_calculated", "q_encoder"),
            ("decouple",),
            joints=(joint,),
            of_paper="The paper gives no size of the difference.",
        )
        for joint in range(1, MOST_JOINTS + 1)
    },
    "fig13": FigureSpec(
        paper.draw_motors,
        "Motor angles, S_inv times the joint angles of the encoders and the expected ones; their difference.",
        ("q_encoder", "q_d"),
        (FIRST,),
        plant=("S_inv",),
        of_paper="The paper does not say with which controller: here Controller 1.",
    ),
    "fig14": FigureSpec(
        paper.draw_tracking,
        f"Joint angles, with the desired ones, and tracking errors of the controllers. {_ERRORS} Table 2 has "
        "the mean errors.",
        ("q_encoder", "e"),
        some=True,
    ),
    "fig15": FigureSpec(
        paper.draw_law,
        "Sliding variable, estimate of the lumped uncertainty and torque of the controllers: "
        f"centred {paper.MEAN_WINDOW * 1e3:g} ms mean, in a band of the RMS of the samples about it over "
        f"{paper.RIPPLE_WINDOW:g} s. The bound of s is that of section 4.3 for Controller 1. "
        "What the bands of all controllers cover is grey. The dark "
        f"line marks the {paper.ZOOM * 1e3:g} ms that the figure {paper.RAW} shows sample by sample.",
        ("s", "H_hat", "tau_m"),
        some=True,
    ),
    "fig16": FigureSpec(
        paper.draw_payload,
        "Controller 1 without and with a payload at the end-effector: joint angles, with the desired ones, "
        f"and tracking errors. {_ERRORS} Table 3 has the mean errors.",
        ("q_encoder", "e"),
        (FIRST, LOADED),
        some=True,
    ),
    paper.RAW: FigureSpec(
        paper.draw_samples,
        f"Every sample of the sliding variable and of the torque over {paper.ZOOM * 1e3:g} ms, where the "
        "desired angle of the joint first rises fastest. A torque is held until the next sample.",
        ("s", "tau_m"),
        some=True,
    ),
}
"""By name; those of the paper are named by their numbers, and its arm has joints 1 to 3."""
