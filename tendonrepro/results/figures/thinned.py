"""Fonts for PDF: matplotlib's own, thinned to the letters that figures have; `fonts/README.md` says how."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.text import Text

FONTS = sorted(Path(__file__).with_name("fonts").glob("*.ttf"))

LETTERS = (range(0x20, 0x300), range(0x370, 0x530), range(0x2000, 0x2300))
"""Characters that the thinned fonts draw, as far as the whole ones do.

They hold marks between 0x300 and 0x370 too, for hats in formulas, but cannot place them over letters."""


@contextmanager
def thinned_fonts(figure: Figure) -> Iterator[None]:
    """Let matplotlib find the thinned fonts first while a block writes a figure.

    Where the figure has other letters, as in the name of a user's file, the whole fonts serve.
    """
    letters = set().union(*(text.get_text() for text in figure.findobj(Text))) - {"\n"}
    if not all(any(ord(letter) in subset for subset in LETTERS) for letter in letters):
        yield
        return
    whole = fontManager.ttflist
    fontManager.ttflist = []
    for path in FONTS:
        fontManager.addfont(path)
    fontManager.ttflist += whole
    try:
        yield
    finally:
        # Matplotlib remembers what it found; adding a font makes it look again.
        fontManager.addfont(FONTS[0])
        fontManager.ttflist = whole
