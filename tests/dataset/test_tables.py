"""Tables in texts and workbooks: what is written comes back under the names above it."""

import pytest

from tendonrepro.dataset.tables import FEWEST, Unreadable
from tendonrepro.dataset.text import read_text_table


def of_text(content, folder):
    path = folder / "SYNTHETIC.txt"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_text_table(path)


TABLE = {"t": [0.0, 1.0, 2.0], "q": [1.5, 2.5, 3.5]}
SPELLINGS = {
    "pipe": "t | q\n0 | 1.5\n1 | 2.5\n2 | 3.5\n",
    "blanks": "  t   q\n  0   1.5\n  1   2.5\n 2   3.5\n",
    "decimal comma, blanks": "t q\n0,0 1,5\n1,0 2,5\n2,0 3,5\n",
    "line ends of Windows": "t,q\r\n0,1.5\r\n1,2.5\r\n2,3.5\r\n",
    "line ends of old Macs": "t,q\r0,1.5\r1,2.5\r2,3.5",
    "separator at the end": "t,q,\n0,1.5,\n1,2.5,\n2,3.5,\n",
    "quoted": '"t";"q"\n"0";"1,5"\n"1";"2,5"\n"2";"3,5"\n',
    "comments": "% made up\n// nothing\nt,q\n0,1.5\n# pause\n1,2.5\n2,3.5\n",
    "names in a comment": "# t q\n0 1.5\n1 2.5\n2 3.5\n",
    "preamble": "SYNTHETIC\nDate: today\n\nt,q\n0,1.5\n1,2.5\n2,3.5\n",
    "hint of Excel": "sep=;\nt;q\n0;1.5\n1;2.5\n2;3.5\n",
    "byte order mark": "\ufefft,q\n0,1.5\n1,2.5\n2,3.5\n",
    "minus sign of typesetters": "t,q\n−0,1.5\n1,2.5\n2,3.5\n",
}  # fmt: skip


def lengthened(text):
    """The text with rows enough for a signal."""
    last = text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n").rsplit("\n", 1)[1]
    end = "\r" if "\n" not in text else "\n"
    return text.rstrip("\r\n") + end + end.join([last] * FEWEST) + end


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_table_is_the_same_however_it_is_spelt(spelling, tmp_path):
    found = of_text(lengthened(SPELLINGS[spelling]), tmp_path)
    assert {name: values[:3].tolist() for name, values in found.items() if name in TABLE} == TABLE


CHINESE = "时间(s),期望角度（deg）,角度(°)\n" + "0,1,2\n" * FEWEST
GERMAN = "Zeit / s;Größe des Winkels (deg);M [N·m]\n" + "0,0;1,5;2,25\n" * FEWEST
DEGREE = "t;q [°]\n" + "0;1\n" * FEWEST


@pytest.mark.parametrize(
    ("table", "encoding"),
    [
        *((CHINESE, encoding) for encoding in ("utf-8", "utf-8-sig", "utf-16", "gbk", "gb18030")),
        (GERMAN, "cp1252"),
        (DEGREE, "cp1252"),
    ],
)
def test_names_come_through_in_every_encoding(table, encoding, tmp_path):
    separator = ";" if ";" in table else ","
    assert list(of_text(table.encode(encoding), tmp_path)) == table.split("\n", maxsplit=1)[0].split(
        separator
    )


NUMBERS = "0,1,2\n" * FEWEST


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("", ["column 1", "column 2", "column 3"]),
        ("t,q2,q3\ns,deg,rad\n", ["t (s)", "q2 (deg)", "q3 (rad)"]),
        (",Controller 1,\nt,q2,q3\n", ["t", "Controller 1 q2", "Controller 1 q3"]),
        ("C1,,C2\nt,q2,q2\n", ["C1 t", "C1 q2", "C2 q2"]),
        ("Run 1\nOperator,Yan\nt,q2,q3\n", ["t", "q2", "q3"]),
        ("t,q2,q2\n", ["t", "q2", "q2 #2"]),
        ("t,s,s\n", ["t", "s", "s #2"]),
    ],
)
def test_rows_above_the_numbers(head, names, tmp_path):
    assert list(of_text(head + NUMBERS, tmp_path)) == names


@pytest.mark.parametrize("text", ["SYNTHETIC\nPayload: 0.2 kg", "rate,1000\nSYNTHETIC", ""])
def test_a_text_for_people_is_no_table(text, tmp_path):
    with pytest.raises(Unreadable):
        of_text(text, tmp_path)
