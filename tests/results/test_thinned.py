"""The thinned fonts draw what matplotlib's own draw."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from fontTools.pens.recordingPen import DecomposingRecordingPen
from fontTools.ttLib import TTFont
from matplotlib import font_manager
from matplotlib.ft2font import FT2Font

from tendonrepro.results.figures.style import FONTS, LETTERS, journal_style, open_figure, thinned_fonts

WORDS = (
    "Simulated, configuration compare.yaml",
    "AVATAR: τ_m = −0.022°",
    "efficient fluff, Tο. «Привет»",
)
ARABIC = "\N{ARABIC LETTER ALEF}"


def whole(path: Path) -> Path:
    return Path(mpl.get_data_path()) / "fonts" / "ttf" / path.name


@pytest.mark.parametrize("path", FONTS, ids=lambda path: path.stem)
def test_letters_are_those_of_the_whole_font(path: Path) -> None:
    def drawn(font: TTFont, letter: int) -> object:
        name, glyphs = font.getBestCmap()[letter], font.getGlyphSet()
        pen = DecomposingRecordingPen(glyphs)
        glyphs[name].draw(pen)
        return glyphs[name].width, pen.value

    with TTFont(path) as thin, TTFont(whole(path)) as full:
        there = [letter for held in LETTERS for letter in held if letter in full.getBestCmap()]
        assert len(there) > 1000
        for letter in there[::7]:
            assert drawn(thin, letter) == drawn(full, letter)
    for words in WORDS:
        places = [np.array(FT2Font(str(font)).set_text(words)) for font in (path, whole(path))]
        np.testing.assert_array_equal(*places)


@pytest.mark.pictures
@pytest.mark.parametrize(("words", "thin"), [(WORDS[1], True), (ARABIC, False)])
def test_a_pdf_takes_the_thinned_font_where_that_has_the_letters(words: str, thin: bool) -> None:
    before = font_manager.findfont("DejaVu Sans")
    assert Path(before) not in FONTS
    with journal_style():
        figure = open_figure(50.0, 20.0)
        figure.suptitle(words)
        with thinned_fonts(figure):
            figure.savefig(io.BytesIO(), format="pdf")
            assert (Path(font_manager.findfont("DejaVu Sans")) in FONTS) == thin
    assert font_manager.findfont("DejaVu Sans") == before
