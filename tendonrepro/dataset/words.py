"""What the names of files, sheets and columns say about the numbers below them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

Quantity: TypeAlias = Literal[
    "time", "desired", "measured", "error", "motor", "calculated", "torque", "surface", "estimate", "rate",
    "acceleration",
]  # fmt: skip


def _these(words: str) -> frozenset[str]:
    return frozenset(words.split())


_GREEK = {"α": " alpha ", "θ": " theta ", "τ": " tau ", "ω": " omega ", "ĥ": " hhat ", "°": " "}
_TOKEN = re.compile(r"[a-z]+|\d+(?:\.\d+)?|[\u4e00-\u9fff]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")

# The first list that holds a word of the name decides: an "error of the joint angle" is an error.
_WORDS: Sequence[tuple[Quantity, frozenset[str]]] = [
    ("time", _these("time times tout timestamp seconds clock")),
    ("error", _these("err error errors deviation")),
    ("surface", _these("sliding surface manifold")),
    (
        "estimate",
        _these("hhat hat estimate estimated estimation lumped uncertainty uncertainties"),
    ),
    ("torque", _these("tau torque torques taum moment")),
    ("acceleration", _these("ddq acc accel acceleration ddtheta")),
    ("rate", _these("dq vel velocity speed omega qdot dtheta rate")),
    ("calculated", _these("calc calculated calculate computed cal")),
    ("motor", _these("motor motors winch shaft qm thetam servo")),
    (
        "desired",
        _these("des desired ref reference expect expected target setpoint qd thetad command"),
    ),
    (
        "measured",
        _these(
            "act actual meas measured real enc encoder feedback pos position angle angles joint link q theta "
            "response output"
        ),
    ),
]
_CHINESE: Sequence[tuple[Quantity, Sequence[str]]] = [
    ("time", ("时间",)),
    ("error", ("误差",)),
    ("surface", ("滑模",)),
    ("estimate", ("估计",)),
    ("torque", ("力矩", "转矩")),
    ("rate", ("速度",)),
    ("calculated", ("计算",)),
    ("motor", ("电机",)),
    ("desired", ("期望", "参考", "目标")),
    ("measured", ("实际", "测量", "编码器", "关节", "角度")),
]
# Letters that mean something only when they stand alone.
_LETTERS: Mapping[str, Quantity] = {
    "t": "time", "e": "error", "s": "surface", "h": "estimate", "u": "torque",
}  # fmt: skip
# Words that count something else than joints.
_NOT_JOINTS = _these(
    "fig figure table tab exp experiment test run trial case sheet column col curve line axes subplot data "
    "file block v version ver no x y var untitled scope port out"
)
_EMPTY = _these("no without un non free empty")
_LOAD = _these("load loaded payload weight loading")
_NO_LOAD = _these("noload unloaded nopayload noloading")
_DECOUPLING = _these("decouple decoupled decoupling coupling kinematics")
_CONTROLLER = _these("controller ctrl control con contr c cont")


@dataclass(frozen=True)
class Hints:
    """What a name says; None where it says nothing.

    Attributes
    ----------
    quantity : Quantity or None
    joint : int or None
        Number in the name; the paper's, unless the data set counts otherwise.
    controller : int or None
    decoupling : bool
        Whether it speaks of the decoupling experiment.
    payload_mass : float or None
        kg; 0 where the name says that there is none, NaN where it says there is one but not how heavy.
    figure : int or None
        Of the paper.
    of_motor : bool
        Whether it is about a motor, whatever the quantity.
    desired : bool
        Whether it is about the desired motion, whatever the quantity.
    """

    quantity: Quantity | None = None
    joint: int | None = None
    controller: int | None = None
    decoupling: bool = False
    payload_mass: float | None = None
    figure: int | None = None
    of_motor: bool = False
    desired: bool = False


def tokens(name: str) -> list[str]:
    """Words and numbers of a name, in lower case: ``qDes2_act`` gives q, des, 2, act."""
    text = _CAMEL.sub(" ", unicodedata.normalize("NFC", name))
    # Compatibility forms last: they would take the hat off its letter.
    text = text.lower()
    for letter, word in _GREEK.items():
        text = text.replace(letter, word)
    return _TOKEN.findall(unicodedata.normalize("NFKC", text))


def hints(name: str) -> Hints:
    """Read one name: of a file without its suffix, a sheet, a variable, a column.

    Parameters
    ----------
    name : str

    Returns
    -------
    Hints
    """
    words = tokens(name)
    return Hints(
        quantity=_quantity(words),
        joint=_joint(words),
        controller=_controller(words),
        decoupling=any(word in _DECOUPLING or "解耦" in word for word in words),
        payload_mass=_payload(words),
        figure=_number_after(words, {"fig", "figure", "图"}),
        of_motor=any(word in _words_of("motor") or "电机" in word for word in words),
        desired=_desired(words),
    )


def _words_of(quantity: Quantity) -> frozenset[str]:
    return dict(_WORDS)[quantity]


def _quantity(words: Sequence[str]) -> Quantity | None:
    letters = [word for word in words if word.isalpha() and word.isascii()]
    if len(letters) == 1 and letters[0] in _LETTERS:
        return _LETTERS[letters[0]]
    for quantity, known in _WORDS:
        if quantity == "measured" and _desired(words):
            return "desired"
        if known.intersection(words):
            return quantity
    found = [quantity for quantity, parts in _CHINESE if any(p in word for p in parts for word in words)]
    return found[0] if found else None


def _desired(words: Sequence[str]) -> bool:
    """Also ``q_d``, ``q2d``, ``theta_2_d``: a d behind an angle."""
    angle = {"q", "theta"}.intersection(words)
    return bool(
        _words_of("desired").intersection(words)
        or (angle and "d" in words and words.index("d") > words.index(next(iter(angle))))
        or any(part in word for part in ("期望", "参考", "目标") for word in words)
    )


def _joint(words: Sequence[str]) -> int | None:
    """A number from 1 to 3 behind a word that can name a joint, the last one if there are several."""
    counted = _NOT_JOINTS | _CONTROLLER
    found = [
        int(number)
        for before, number, after in zip(words, words[1:], [*words[2:], ""], strict=False)
        if number in {"1", "2", "3"}
        and not (before in counted or before[0].isdigit() or "控制器" in before or after in {"kg", "g"})
    ]
    return found[-1] if found else None


def _controller(words: Sequence[str]) -> int | None:
    for before, number in _pairs(words):
        if number in {"1", "2", "3"} and (before in _CONTROLLER or "控制器" in before):
            return int(number)
    have = set(words)
    if have & {"alpha", "atde", "alphatde"}:
        return 1
    if have & {"ntsm", "tdentsm", "ntsmc"}:
        return 2
    return 3 if have & {"tsm", "tdetsm", "tsmc", "tdc", "tdepd", "pd"} else None


def _payload(words: Sequence[str]) -> float | None:
    for number, unit in _pairs(words):
        if unit in {"kg", "g"} and number.replace(".", "", 1).isdigit():
            return float(number) * (1.0 if unit == "kg" else 1e-3)
    joined = "".join(words)
    if _NO_LOAD.intersection(words) or any(part in joined for part in ("空载", "无负载")):
        return 0.0
    for place, word in enumerate(words):
        if word in _LOAD:
            return 0.0 if place and words[place - 1] in _EMPTY else float("nan")
    return float("nan") if "负载" in joined else None


def _number_after(words: Sequence[str], marks: set[str]) -> int | None:
    numbers = [int(number) for before, number in _pairs(words) if before in marks and number.isdigit()]
    return numbers[0] if numbers else None


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    return pairwise(words)
