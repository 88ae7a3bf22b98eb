"""A finished table as Markdown and LaTeX text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

NOTHING = "--"
"""What stands where there is no number."""

_TEX = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


@dataclass(frozen=True)
class Sheet:
    """A table whose cells are text already.

    Parameters
    ----------
    caption : str
        Plain text.
    headings : list of str
        One per column.
    numeric : list of bool
        Which columns hold numbers; these stand to the right.
    rows : list of list of str
        Cells, one per column; `NOTHING` for a missing number.
    """

    caption: str
    headings: list[str]
    numeric: list[bool]
    rows: list[list[str]]


def markdown(sheet: Sheet) -> str:
    """Return the caption and a pipe table."""
    rule = ["---:" if number else ":---" for number in sheet.numeric]
    escaped = [[cell.replace("|", r"\|") for cell in cells] for cells in (sheet.headings, *sheet.rows)]
    lines = [f"| {' | '.join(cells)} |" for cells in (escaped[0], rule, *escaped[1:])]
    return "\n".join([sheet.caption, "", *lines, ""])


def latex(sheet: Sheet, label: str) -> str:
    """Return a ``table`` float that needs the package booktabs; its label is ``tab:<label>``."""
    columns = "".join("r" if number else "l" for number in sheet.numeric)
    typeset: list[Callable[[str], str]] = [_tex_number if number else _tex for number in sheet.numeric]
    body = [[write(cell) for write, cell in zip(typeset, row, strict=True)] for row in sheet.rows]
    head, *body_lines = [" & ".join(cells) + r" \\" for cells in ([*map(_tex, sheet.headings)], *body)]
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{_tex(sheet.caption)}}}",
        rf"\label{{tab:{label}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        head,
        r"\midrule",
        *body_lines,
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join([*lines, ""])


def _tex(text: str) -> str:
    return "".join(_TEX.get(character, character) for character in text)


def _tex_number(text: str) -> str:
    # A hyphen is not a minus sign.
    return text if text == NOTHING else text.replace("-", "$-$")
