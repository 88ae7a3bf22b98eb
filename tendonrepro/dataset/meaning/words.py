"""What the names of files, sheets and columns say about the numbers below them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal, TypeAlias

from tendonrepro.dataset.readers.units import plain_unit

Quantity: TypeAlias = Literal[
    "time", "index", "desired", "measured", "error", "motor", "calculated", "torque", "surface", "estimate",
    "rate", "acceleration", "other",
]  # fmt: skip

_GREEK = {
    "α": " alpha ", "θ": " theta ", "τ": " tau ", "ω": " omega ", "σ": " sigma ", "ĥ": " hhat ",
    "°": " ", "º": " ",
}  # fmt: skip
_TOKEN = re.compile(r"[a-z]+|\d+(?:\.\d+)?|[\u4e00-\u9fff]+")
_OTHER_SIGNS = re.compile(r"[^\W\d_]+|[√∫∑‰∂±×÷∞²³\u0300-\u036f]")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_RANGE = re.compile(r"!\d+:\d+$")
_MASS = re.compile(r"(?<![a-z0-9.,])(\d+(?:[.,p]\d+)?)\s*(kg|g)(?![a-z])")
_WITHOUT = re.compile(r"(?<![a-z])w/o(?![a-z])")
_DASHES = re.compile(r"[\u2010-\u2015\u2212\ufe58\ufe63\uff0d]")
_DAY = re.compile(r"(?<!\d)20\d\d([-_.]?)[01]\d\1[0-3]\d(?!\d)")


def _these(words: str) -> frozenset[str]:
    return frozenset(words.split())


# The first line that knows a word of the name decides: an "error of the joint angle" is an error. Behind the
# English words stand parts of Chinese ones.
_WORDS: Mapping[Quantity, tuple[frozenset[str], Sequence[str]]] = {
    "time": (_these("time times tout timestamp seconds clock"), ("时间",)),
    "index": (_these("sample samples index idx"), ("序号", "采样点")),
    "other": (
        _these("de edot current voltage tension force pressure obstacle obs"),
        ("电流", "电压", "张力", "障碍"),
    ),
    "error": (_these("err error errors deviation"), ("误差",)),
    "surface": (_these("sliding surface manifold sigma"), ("滑模",)),
    "estimate": (
        _these("hhat hat estimate estimated estimation lumped uncertainty uncertainties"),
        ("估计",),
    ),
    "torque": (_these("tau torque torques taum moment"), ("力矩", "转矩", "扭矩")),
    "acceleration": (_these("ddq acc accel acceleration ddtheta ddqd"), ("加速度",)),
    "rate": (_these("dq vel velocity speed omega qdot dot dtheta dth rate dqd"), ("速度",)),
    "calculated": (_these("calc calculated calculate computed cal"), ("计算",)),
    "motor": (_these("motor motors winch shaft qm thetam thm servo"), ("电机", "马达")),
    "desired": (
        _these("des desired ref reference expect expected target setpoint qd qr thetad thd yd command"),
        ("期望", "参考", "目标"),
    ),
    "measured": (
        _these("act actual meas measured real enc encoder feedback pos position angle angles joint link q th")
        | _these("theta response output"),
        ("实际", "测量", "编码器", "关节", "角度", "转角"),
    ),
}
_OF_ERRORS: Sequence[Quantity] = (
    "other",
    "surface",
    "estimate",
    "torque",
    "acceleration",
    "rate",
    "calculated",
    "motor",
)
"""Quantities whose error is none of tracking."""
_OF_ESTIMATES: Sequence[Quantity] = ("torque", "acceleration", "rate", "motor")
"""Those whose estimate is not that of the lumped dynamics."""
# Letters that mean something only when they stand alone.
_LETTERS: Mapping[str, Quantity] = {
    "t": "time", "e": "error", "s": "surface", "h": "estimate", "u": "torque", "n": "index", "k": "index",
}  # fmt: skip
_QUANTITIES = _these("e s h u")
_JOINTS = _these("0 1 2 3")
_ANGLES = _these("q th theta")
_OF_JOINTS = _ANGLES | _these("qd qr thetad thd")
_REACHED = _these("act actual meas measured real feedback")
NOT_JOINTS = _these(
    "fig figure table tab tabelle feuil hoja exp experiment test run trial case sheet column col curve line "
    "axes subplot data file block v version ver no x y var untitled scope port out"
)
"""Words that count something else than joints."""
_FEW = 6  # names that a line shows
_EMPTY = _these("no without wo un non not free empty zero 无 不 非")
_LOAD = _these("load loaded payload weight loading")
_NO_LOAD = ("noload", "unload", "nopayload", "withoutload", "withoutpayload", "空载", "无负载", "无载")
_CHINESE_LOAD = ("负载", "带载", "有载", "加载")
_DECOUPLING = _these("decouple decoupled decoupling coupling kinematics")
_CONTROLLER = _these("controller ctrl control con contr c cont")
_NTSM = _these("ntsm tdentsm ntsmc")
_TSM = _these("tsm tdetsm tsmc")
_ALPHA = _these("alpha atde alphatde proposed")
_ABOUT = _these(
    "d r m tde tdc of the and in for to from by at on with is vs versus data result results log logs record "
    "recorded recording measurement measurements experiment experiments experimental control tracking "
    "trajectory motion signal signals value values robot arm manipulator tendon side kg j noload unload "
    "nopayload array all final comparison paper"
)
"""Words that change nothing of what a column is."""
_PLACES = frozenset().union(*(known for known, _ in _WORDS.values())) | {"side", "cell"}
"""Words before which a "load" is where something is measured."""
_KNOWN = (
    frozenset().union(*(known for known, _ in _WORDS.values())) | _LETTERS.keys() | _ANGLES | NOT_JOINTS
    | _LOAD | _DECOUPLING | _CONTROLLER | _NTSM | _TSM | _ALPHA | _ABOUT
)  # fmt: skip
_CHINESE_PARTS = {
    *_CHINESE_LOAD, *(word for word in _NO_LOAD if not word.isascii()), "解耦",
    *(part for _, parts in _WORDS.values() for part in parts),
    *_these("数据 实验 控制 控制器 结果 曲线 跟踪 轨迹 位置 位移 机械臂"),
    *_these("图 表 第 的 和 与 号 角 值 度 弧度 秒 毫秒"),
}  # fmt: skip
_CHINESE = re.compile("|".join(sorted(_CHINESE_PARTS, key=len, reverse=True)))
"""Known parts of Chinese names; a word is known where nothing else is left of it."""


@dataclass(frozen=True)
class Hints:
    """What a name says; None where it says nothing.

    The `joint` is a number from 0 to 3, the paper's unless the data set counts otherwise. `payload_mass`,
    kg, is 0 where the name says that there is none, NaN where there is one but not how heavy. `of_motor` and
    `desired` are about motors and the desired motion whatever the quantity. A quantity that a single `letter`
    tells is worth little but as a column's own name. Words of the `name` of which nothing is known here are
    `unread`: each may change what the others say.
    """

    quantity: Quantity | None = None
    joint: int | None = None
    controller: int | None = None
    decoupling: bool = False
    payload_mass: float | None = None
    of_motor: bool = False
    desired: bool = False
    letter: bool = False
    name: str = ""
    unread: tuple[str, ...] = ()


def tokens(name: str) -> list[str]:
    """Words and numbers of a name, in lower case: ``qDes2_act`` gives q, des, 2, act."""
    return _TOKEN.findall(_plain(_CAMEL.sub(" ", name)))


def hints(name: str) -> Hints:
    """Read one name: of a file without its suffix, a sheet, a variable, a column, a title."""
    name = _RANGE.sub("", name)
    words, text = tokens(name), _plain(name)
    quantity, letter = _quantity(words)
    joints, controllers, unread = _joints(words), _controllers(words), _unread(text, quantity)
    decoupling = any(word in _DECOUPLING or "解耦" in word for word in words)
    if quantity == "error" and any(_about(other, words) for other in _OF_ERRORS):
        unread += ("error of what",)
    of_angle = (_ANGLES | _these("angle angles pos position")).intersection(words) or any(
        map(partial(_about, words=words), _OF_ESTIMATES)
    )
    if quantity == "torque" and (_desired(words) or _LOAD.intersection(words)):
        unread += ("torque of what",)
    if quantity == "estimate" and of_angle:
        unread += ("estimate of what",)
    if sum(word in _OF_JOINTS for word in words) > 1 or (_desired(words) and _REACHED.intersection(words)):
        # As in qd2-q2: a difference of two.
        unread += ("desired or measured",)
    if len({*joints}) > 1:
        unread += tuple(map(str, dict.fromkeys(joints)))
    if len({*controllers}) > 1:
        unread += (" or ".join(f"controller {number}" for number in controllers),)
    if controllers and decoupling:
        # As in the paper's title, which says nothing of a file.
        unread, controllers, decoupling = (*unread, "decoupling or a controller"), [], False
    return Hints(
        quantity=quantity,
        joint=joints[-1] if joints else None,
        controller=controllers[0] if controllers else None,
        decoupling=decoupling,
        payload_mass=_payload(words, text),
        of_motor=_about("motor", words) or _behind_angle(words, "m"),
        desired=_desired(words),
        letter=letter,
        name=name,
        unread=unread,
    )


def _unread(text: str, quantity: Quantity | None) -> tuple[str, ...]:
    """Words of a name that say nothing known, numbers that count nothing known, and what a "no" denies."""
    words, found = tokens(_MASS.sub(" ", _DAY.sub(" ", text))), []
    weighed = _MASS.search(text) is not None
    for before, word, after in zip(["", *words], words, [*words[1:], ""], strict=False):
        if word in _EMPTY:
            known = after in _LOAD
        elif word[0].isdigit():
            counts = _KNOWN - _LOAD if word in _JOINTS else NOT_JOINTS - {"x", "y"}
            known = before in counts or (bool(before) and not _CHINESE.sub("", before))
            known = known or (word == "0" and before in _LOAD | {"kg"} and not weighed)
        else:
            alone = len(words) == 1 == len(word)
            known = alone or word in _KNOWN or not _CHINESE.sub("", word)
            known = known or (len(word) > 1 and plain_unit(word) is not None)
            # Behind an angle, as in q_s, a letter is none of those that stand alone.
            letter = len(word) == 1 and word not in _ANGLES and word not in "drm"
            known = known and not (letter and _behind_angle(words, word))
            # Nor is one beside a word that says something else, as in e_dot; the panel in fig15e is.
            panel = before[:1].isdigit() and before not in _JOINTS
            second = word == "s" and (quantity == "time" or plain_unit(before) is not None)
            # C1_load_q may be q under load, or at the side of the load.
            known = known and not (word in _LOAD and after in _PLACES - {"side", "cell"})
            if quantity and word in _QUANTITIES and not panel and not second:
                known = _LETTERS[word] == quantity
        if not known:
            found.append(word)
    # Words in other letters, and signs such as π, √ or ‰.
    return (*found, *dict.fromkeys(_OTHER_SIGNS.findall(_TOKEN.sub(" ", text))))


def _plain(name: str) -> str:
    """Lower case, Greek letters as words, wide forms as narrow ones."""
    text = _DASHES.sub("-", unicodedata.normalize("NFC", name).lower())
    text = _WITHOUT.sub("without", text)
    # Compatibility forms last: they would take the hat off its letter.
    for letter, word in _GREEK.items():
        text = text.replace(letter, word)
    return unicodedata.normalize("NFKC", text)


def _about(quantity: Quantity, words: Sequence[str]) -> bool:
    known, parts = _WORDS[quantity]
    return bool(known.intersection(words)) or any(part in word for part in parts for word in words)


def _quantity(words: Sequence[str]) -> tuple[Quantity | None, bool]:
    """Quantity of a name, and whether a letter alone tells it."""
    letters = [word for word in words if word.isalpha() and (len(word) == 1 or not plain_unit(word))]
    if len(letters) == 1 and letters[0] in _LETTERS:
        return _LETTERS[letters[0]], True
    for quantity in _WORDS:
        if quantity == "motor" and _behind_angle(words, "m"):
            return "motor", False
        if quantity == "measured" and _desired(words):
            return "desired", False
        if _about(quantity, words):
            return quantity, False
    return None, False


def _behind_angle(words: Sequence[str], letter: str) -> bool:
    """Whether a letter stands behind an angle, as in ``q_d``, ``q2d``, ``theta_m2``."""
    places = [place for place, word in enumerate(words) if word in _ANGLES]
    return bool(places) and letter in words[places[0] :]


def _desired(words: Sequence[str]) -> bool:
    behind = any(_behind_angle(words, letter) for letter in "dr")
    return behind or _about("desired", words) or bool({"dqd", "ddqd"}.intersection(words))


def _joints(words: Sequence[str]) -> list[int]:
    """Numbers from 0 to 3 behind words that can name a joint; behind known ones if there are any."""
    counted = NOT_JOINTS | _CONTROLLER | _LOAD
    found = [
        (before in _KNOWN or not _CHINESE.sub("", before), int(number))
        for before, number, after in zip(words, words[1:], [*words[2:], ""], strict=False)
        if number in _JOINTS
        and not (before in counted or before[0].isdigit() or after in {"kg", "g"})
        and not any(part in before for part in ("控制器", "图", "表"))
    ]
    return [number for known, number in found if known] or [number for _, number in found]


def _controllers(words: Sequence[str]) -> list[int]:
    """Controllers of a name: by the name of its law, which comes first, and by number."""
    denied = any(before in _EMPTY and word not in _LOAD for before, word in pairwise(words))
    alpha = ("a", "tde") in pairwise(words) or _ALPHA.intersection(words)
    laws = (1, alpha and not denied), (2, _NTSM.intersection(words)), (3, _TSM.intersection(words))
    numbers = (
        int(number)
        for before, number in pairwise(words)
        if number in {"1", "2", "3"} and (before in _CONTROLLER or "控制器" in before)
    )
    return [*[number for number, named in laws if named][:1], *numbers]


def _payload(words: Sequence[str], text: str) -> float | None:
    mass = _MASS.search(text)
    if mass:
        return float(re.sub("[,p]", ".", mass[1])) * (1.0 if mass[2] == "kg" else 1e-3)
    joined, followed = "".join(words), _loads(words)
    denied = any(before in _EMPTY and word in _LOAD for before, word in pairwise(words))
    if denied or any(part in joined for part in _NO_LOAD) or {"0", "0.0"}.intersection(followed):
        return 0.0
    return float("nan") if followed or any(part in joined for part in _CHINESE_LOAD) else None


def _loads(words: Sequence[str]) -> list[str]:
    """What follows the words for a load, but for its unit; "load side" and "load torque" are places."""
    bare = [*(word for word in words if word not in {"kg", "g"}), ""]
    return [after for word, after in pairwise(bare) if word in _LOAD and after not in _PLACES]


def printable(text: str) -> str:
    """One line that steers no terminal and ends no comment: odd white space is a space, the rest U+FFFD."""
    return "".join(
        letter if letter.isprintable() else " " if letter.isspace() else "\ufffd" for letter in text
    )


def few(names: Sequence[str]) -> str:
    """Names in one line that steers no terminal, the first few of many."""
    more = len(names) - _FEW
    return ", ".join(map(printable, names[:_FEW])) + (f" and {more} more" if more > 0 else "")
