"""The font of figures: text and mathematics of the family asked for, in its size; the default as it was."""

import io
import re
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib import font_manager
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.text import Text

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.reports import publication
from mbsbench.reports.model.results import read_results
from mbsbench.reports.plots import fonts, paper
from mbsbench.reports.plots.fonts import COMPUTER_MODERN, DEFAULT_FONT, Font, find_font

from .conftest import every_kind

BUNDLED = ("DejaVu Serif", "STIXGeneral", "cmr10", "DejaVu Sans Mono")  # those of matplotlib, everywhere
FAMILY = {
    "DejaVu Serif": "DejaVuSerif",
    "STIXGeneral": "STIX",
    "cmr10": "Cm",
    "DejaVu Sans Mono": "DejaVuSansMono",
    "DejaVu Sans": "DejaVuSans",
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lettered")
    every_kind(folder)
    return read_results(folder)


def laws_of(results):
    """How the figure with mathematics in its axes is drawn."""
    variant = next(v for v in results.variants if v.title == "pendulum")
    made = {name: draw for name, _, _, draw in publication.list_figures(results, variant)}
    return made["pendulum-recommended-laws"]


def fonts_in(draw, font: Font) -> set[str]:
    """Names of the fonts in a PDF, without the tags of subsets."""
    with paper.apply_style(font), mpl.rc_context({"pdf.compression": 0}):
        out = io.BytesIO()
        FigureCanvasPdf(draw()).print_pdf(out)
    found = re.findall(rb"/BaseFont /(?:[A-Z]{6}\+)?(\S+)", out.getvalue())
    return {name.decode() for name in found}


def test_the_default_changes_no_setting():
    """Published pictures stay as they are."""
    assert find_font() == DEFAULT_FONT == Font() and not DEFAULT_FONT.settings
    with paper.apply_style():
        plain = dict(mpl.rcParams)
    with paper.apply_style(find_font("dejavu sans", 8.0)):
        assert dict(mpl.rcParams) == plain
    assert (plain["font.family"][0], plain["font.size"]) == (fonts.DEFAULT, fonts.SIZE)
    assert {plain[k] for k in ("legend.fontsize", "xtick.labelsize", "ytick.labelsize")} == {fonts.SIZE * fonts.SMALL}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("family", BUNDLED)
def test_text_and_mathematics_are_of_the_family(results, family):
    """Every font in the PDF is of the family, but for single signs that it lacks."""
    draw = laws_of(results)
    found = fonts_in(draw, find_font(family))
    own = {name for name in found if name.startswith(FAMILY[family])}
    rest = found - own
    assert own and rest <= {"DejaVuSans"}, rest
    if family != "DejaVu Serif":
        assert all(name.startswith("DejaVuSans") for name in fonts_in(draw, DEFAULT_FONT))


@pytest.mark.sampled(0)
@pytest.mark.parametrize(("family", "size"), [("DejaVu Sans", 8.0), ("DejaVu Serif", 6.0), ("STIXGeneral", 11.0)])
def test_every_text_has_the_size_or_seven_eighths_of_it(results, family, size):
    """In every figure of a folder; legends and their lines grow with the letters."""
    overview = next(v for v in results.variants if v.title == "pendulum")
    with paper.apply_style(find_font(family, size)):
        for name, _, _, draw in publication.list_figures(results, overview):
            if name.endswith(("-energy", "-work", "-laws")):
                figure = draw()
                FigureCanvasPdf(figure).print_pdf(io.BytesIO())
                shown = [t for t in figure.findobj(Text) if t.get_text().strip() and t.get_visible()]
                assert {t.get_fontsize() for t in shown} <= {size, size * fonts.SMALL}
                assert {t.get_fontname() for t in shown} == {family}
        small = paper.Legend((mpl.lines.Line2D([], [], label="a"),), 1).height
    assert small == pytest.approx(0.14 * size / 8.0)


def test_powers_are_set_as_mathematics_beside_another_font(results):
    """Few fonts have all superscripts; the default has, and its files stay as they were."""
    texts = {}
    for family in ("DejaVu Sans", "STIXGeneral"):
        with paper.apply_style(find_font(family)):
            figure = laws_of(results)()
            FigureCanvasPdf(figure).print_pdf(io.BytesIO())
            texts[family] = "".join(t.get_text() for t in figure.findobj(Text))
    assert "10⁻" in texts["DejaVu Sans"] and "10$^{-" in texts["STIXGeneral"]
    assert not re.search("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]", texts["STIXGeneral"])


def test_latex_is_the_best_computer_modern_that_is_here(monkeypatch):
    """Matplotlib's own where no other is installed: it is everywhere."""
    assert find_font("latex").family in COMPUTER_MODERN
    monkeypatch.setattr(font_manager.fontManager, "get_font_names", lambda: [*BUNDLED, "DejaVu Sans"])
    assert find_font("LaTeX").family == "cmr10" and find_font("serif").family == "DejaVu Serif"


@pytest.mark.skipif(find_font("latex").family == "cmr10", reason="no font of LaTeX documents is installed")
def test_postscript_outlines_are_drawn_and_not_taken_for_truetype(results, tmp_path):
    """A PDF whose TrueType font holds PostScript outlines is none that a printer takes."""
    font = find_font("latex")
    (file,) = paper.save_figure(laws_of(results), ConfinedPath(tmp_path), "laws", ("pdf",), font)
    truetype = b"/FontFile2" in file.read_bytes()
    postscript = Path(font_manager.findfont(font.family)).read_bytes()[:4] == b"OTTO"
    assert truetype != postscript == (b"/Type3" in file.read_bytes())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--font", "DejaVu Seriff"], "nearest are DejaVu Serif, "),
        (["--font", "stix"], "STIXGeneral"),
        (["--font", "STIXSizeOneSym"], "a font of symbols"),
        (["--font", "Qqxzw 77"], "nearest are DejaVu Sans, DejaVu Serif, STIXGeneral, cmr10"),
        (["--font-size", "90"], "must be 4 to 20 points (got 90)"),
        (["--font-size", "big"], "(got 'big')"),
        (["--paper", "--font", "nothing of the kind"], "is installed"),
    ],
)
def test_a_font_that_is_not_here_is_refused_in_one_line(results, capsys, given, words):
    """Exit code 2; nothing is drawn."""
    assert main(["figures", str(results.folder), *given]) == 2
    said = capsys.readouterr().err
    assert words in said and said.strip().count("\n") == 0 and "Traceback" not in said
    assert not (results.folder / publication.FOLDER).exists()


@pytest.mark.sampled(0)
def test_the_command_draws_in_the_font(results, capsys):
    """The same panels and captions, in another family; the paper's own figures take it as well."""
    for more, place in ((["--only", "lonely"], "publication"), (["--paper", "--only", "fig05"], "paper")):
        assert main(["figures", str(results.folder), "--font", "STIXGeneral", "--font-size", "9", *more]) == 0
        capsys.readouterr()
        drawn = [p.read_bytes() for p in (results.folder / place).rglob("*.pdf")]
        assert drawn and all(b"STIX" in text for text in drawn)
