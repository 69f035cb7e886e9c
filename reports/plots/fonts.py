"""Choose the font of printed figures: an installed family, with mathematics in the same letters.

``latex`` stands for the family of LaTeX's own documents, if it is installed; missing characters come from the default
font.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from matplotlib import font_manager

DEFAULT, SIZE = "DejaVu Sans", 8.0  # as in print.mplstyle; [pt]
SIZES = (4.0, 20.0)  # [pt] smallest and largest size allowed
SMALL = 7.0 / 8.0  # relative size of ticks and legends
LATEX = "latex"
COMPUTER_MODERN = ("LM Roman 10", "CMU Serif", "Latin Modern Roman", "cmr10")  # the last one comes with matplotlib
GENERIC = ("serif", "sans-serif", "monospace")
MATHS = {  # families with a math font set in matplotlib
    "DejaVu Sans": "dejavusans",
    "DejaVu Serif": "dejavuserif",
    "STIXGeneral": "stix",
    "cmr10": "cm",
}
NEAREST, ALIKE = 5, 0.4  # names suggested for a missing one; least similarity, from 0 to 1


@dataclass(frozen=True)
class Font:
    """An installed family and the size of titles and labels [pt]."""

    family: str = DEFAULT
    size: float = SIZE

    @property
    def settings(self) -> Mapping[str, Any]:
        """The matplotlib settings that the font changes; empty for the default."""
        small = self.size * SMALL
        sizes = {
            "font.size": self.size,
            "axes.titlesize": self.size,
            "axes.labelsize": self.size,
            "legend.fontsize": small,
            "xtick.labelsize": small,
            "ytick.labelsize": small,
        }
        if self.family == DEFAULT:
            return {} if self.size == SIZE else sizes
        italic = f"{self.family}:italic"
        maths = {"mathtext.fontset": MATHS.get(self.family, "custom")}
        if maths["mathtext.fontset"] == "custom":  # the family's own letters and digits; Greek from a similar set
            modern = self.family.startswith(("LM ", "Latin Modern", "CMU"))
            fallback = "cm" if modern else "stixsans" if "sans" in self.family.casefold() else "stix"
            maths |= {
                "mathtext.rm": self.family,
                "mathtext.it": italic,
                "mathtext.cal": italic,
                "mathtext.bf": f"{self.family}:bold",
                "mathtext.bfit": f"{italic}:bold",
                "mathtext.sf": self.family,
                "mathtext.fallback": fallback,
            }
        # outlines, if the file cannot be embedded in a PDF
        embedded = {"pdf.fonttype": 3} if _is_postscript(self.family) else {}
        return {
            **sizes,
            **maths,
            **embedded,
            "font.family": [self.family, DEFAULT],
            "axes.formatter.use_mathtext": True,
        }


DEFAULT_FONT = Font()


def find_font(family: str = "", size: float | None = None) -> Font:
    """Return the font of an installed ``family`` and a ``size`` [pt]; defaults replace what is not given.

    Raise ValueError for a size outside ``SIZES``, or with the nearest families for a family that is not installed.
    """
    if size is not None and not SIZES[0] <= size <= SIZES[1]:
        raise ValueError(f"--font-size must be {SIZES[0]:g} to {SIZES[1]:g} points (got {size:g})")
    return Font(_find_family(family.strip()) if family else DEFAULT, SIZE if size is None else size)


def _find_family(asked: str) -> str:
    """Return the installed family for a name, a generic name (``serif``) or ``latex``.

    Raise ValueError if it is not installed, or has no letters.
    """
    known = {name.casefold(): name for name in font_manager.fontManager.get_font_names()}
    if asked.casefold() == LATEX:
        return next(name for name in COMPUTER_MODERN if name.casefold() in known)
    if asked.casefold() in GENERIC:
        return font_manager.get_font(font_manager.findfont(asked.casefold())).family_name
    if asked.casefold() in known:
        family = known[asked.casefold()]
        if ord("e") in font_manager.get_font(font_manager.findfont(family)).get_charmap():
            return family
        raise ValueError(f"--font: {family} is a font of symbols, without letters")
    within = sorted((key for key in known if asked.casefold() in key), key=len)
    near = [known[key] for key in (*within, *difflib.get_close_matches(asked.casefold(), known, NEAREST, ALIKE))]
    shown = ", ".join([*dict.fromkeys(near)][:NEAREST] or MATHS)
    raise ValueError(f"--font: no family {asked!r} is installed; nearest are {shown}; {LATEX} stands for LaTeX's own")


@cache
def _is_postscript(family: str) -> bool:
    """Return whether the font file has PostScript outlines (OpenType with CFF).

    Matplotlib would wrongly embed these as TrueType. Such files have version 0.5 of the table ``maxp``, TrueType has
    1.0.
    """
    table = font_manager.get_font(font_manager.findfont(family)).get_sfnt_table("maxp")
    return table is None or table["version"] != (1, 0)
