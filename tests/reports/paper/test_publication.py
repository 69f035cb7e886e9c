"""Figures and tables for papers: journal widths, fonts inside, LaTeX and CSV with the same numbers."""

import csv
import io
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.base.files import write_text
from mbsbench.reports import publication
from mbsbench.reports.model import tables
from mbsbench.reports.model.floats import format_latex_caption
from mbsbench.reports.model.results import read_results
from mbsbench.reports.plots.paper import DOUBLE, SINGLE, apply_style, save_figure
from mbsbench.tests.factories import make_measured_record, make_swing

from ..conftest import every_kind, put

TOP, BIN = Path(publication.__file__).parents[1], Path(sys.executable).parent
NUMBER = re.compile(r"\$(-?[\d.]+)(?:\\,(\d+))*(?:\\times 10\^\{(-?\d+)\})?\$")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hand-made")
    every_kind(folder)
    put(
        folder,
        make_measured_record("ab12", "alpha", dt_s=0.0025, energy_drift_max_J=1.23456e-7),
        make_swing(600, size=1e-7),
    )
    return read_results(folder)


def value(latex: str) -> float | None:
    """The number that a reader sees in LaTeX; None for text."""
    plain = latex.strip().replace(r"\,", "")
    found = NUMBER.fullmatch(plain)
    return float(f"{found[1]}e{found[3] or 0}") if found else None


def test_latex_and_csv_have_the_same_numbers(results):
    """Run by run: LaTeX has three digits of what the CSV has in full."""
    variant = max(results.variants, key=lambda p: len(p.runs))
    latex = tables.format_as_latex(variant.title, variant.runs)
    rows = [line.removesuffix(r" \\").split(" & ") for line in latex.splitlines() if line.endswith(r"\\")][1:]
    plain = list(csv.DictReader(io.StringIO(tables.format_as_csv(variant.runs))))
    heads = [f"{c.key} [{c.unit}]" if c.unit else c.key for c in tables.list_printed_columns(variant.runs)]
    compared = 0
    assert len(rows) == len(plain) == len(variant.runs)
    for a, b in zip(rows, plain, strict=True):  # LaTeX has the solver in a line above its runs
        for shown, head in zip(a, heads, strict=True):
            if shown.strip() == "--":
                assert b[head] == ""
            elif (number := value(shown)) is not None:
                assert number == pytest.approx(float(b[head]), rel=5.1e-3), (shown, b[head])
                compared += 1
    assert compared > 5 * len(rows) / 2


def test_latex_is_balanced_and_harmless(results):
    """Braces close, dollars pair, every row has as many columns, nothing hostile is a command."""
    for variant in results.variants:
        lines = [k for k in tables.format_as_latex(variant.title, variant.runs).splitlines() if not k.startswith("%")]
        text = "\n".join(lines)
        body = re.sub(r"\\[\\{}$&%#_]", "", text)
        assert body.count("{") == body.count("}")
        assert [k[: k.index("{")] for k in lines if "{tabular}" in k] == [r"\begin", r"\end"]
        assert all(re.sub(r"\\\$", "", k).count("$") % 2 == 0 for k in lines)
        rows = [re.sub(r"\\&", "", k) for k in lines if k.endswith(r"\\")]
        assert len(rows) == len(variant.runs) + 1
        assert {k.count("&") for k in rows} == {len(tables.list_printed_columns(variant.runs)) - 1}
        assert r"\frac" not in text and "<script>" not in text


def test_latex_fits_one_column_of_a_journal(results):
    """86 mm at 8 pt: a digit is half an em wide, 1.4 mm; 2 pt to each side of a column; words wrap where it says."""
    for variant in results.variants:
        text = tables.format_as_latex("t", variant.runs)
        rows = [k.removesuffix(r" \\").split(" & ") for k in text.splitlines() if k.endswith(r"\\")]
        widths = []
        for column, cells in zip(tables.list_printed_columns(variant.runs), zip(*rows, strict=True), strict=True):
            fixed = re.search(r"p\{(\d+)mm\}", tables.WRAPPED.get(column.key, ""))
            longest = max(len(re.sub(r"\\[a-zA-Z]+|[${}^\\ ]", "", e)) for e in cells)
            widths.append(float(fixed[1]) if fixed else 1.4 * longest)
        assert sum(widths) + 1.4 * (len(widths) - 1) <= SINGLE * 25.4, widths


def test_widths_are_those_of_a_journal(results):
    assert 84.0 <= SINGLE * 25.4 <= 90.0 and 174.0 <= DOUBLE * 25.4 <= 180.0
    variant = next(p for p in results.variants if p.title == "pendulum")
    made = {name: (width, draw) for name, _, width, draw in publication.list_figures(results, variant)}
    assert {
        "pendulum-recommended-energy",
        "pendulum-recommended-constraints",
        "pendulum-recommended-step",
        "pendulum-work",
        "pendulum-recommended-laws",
    } <= set(made)
    folder = ConfinedPath(results.folder) / "widths"
    for name in ("pendulum-recommended-constraints", "pendulum-work"):
        (pdf,) = save_figure(made[name][1], folder, name, ("pdf",))
        box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", pdf.read_bytes())
        assert float(box[1]) == pytest.approx(made[name][0] * 72.0, abs=0.1)
        assert b"/FontFile2" in pdf.read_bytes()


@pytest.mark.parametrize("only", ["lonely", pytest.param("", marks=pytest.mark.slow)], ids=["one problem", "all"])
def test_floats_have_captions_and_labels(results, capsys, only):
    """One a figure and a table, of files that are there; symbols are LaTeX's, and no label is used twice."""
    assert main(["figures", str(results.folder), *(["--only", only] if only else [])]) == 0
    capsys.readouterr()
    folder = results.folder / publication.FOLDER
    text = (folder / "floats.tex").read_text(encoding="utf-8").partition(r"\providecommand")[2]
    told = json.loads((folder / "captions.json").read_text(encoding="utf-8"))
    files = re.findall(r"\{\\publication/([^}]+)\}", text)
    tabled = [v for v in results.variants if only in ("", v.title)]
    assert tabled and len(files) == len(set(files)) == len(told) + len(tabled)
    assert all((folder / file).is_file() for file in files)
    labels = re.findall(r"\\label\{([^}]+)\}", text)
    assert len(labels) == len(set(labels)) == len(files) == text.count(r"\caption{") == text.count(r"\end{")
    ours = "".join(format_latex_caption(publication.WORK + publication.HEAT + " φ̇ φ Δt 10⁻⁵ |E − E₀|"))
    assert ours.isascii() and r"$\dot\phi$ $\phi$ $\Delta$t 10$^{-}$$^5$" in ours


@pytest.mark.sampled(0)
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX on this machine")
def test_latex_takes_the_floats(tmp_path):
    """With the packages that its first line names."""
    for k, solver in enumerate(("alpha", "be_ta")):
        put(tmp_path / "run", make_measured_record(f"{k:04x}", solver, problem="cha_in"), make_swing(40))
    assert main(["figures", str(tmp_path / "run")]) == 0
    lines = r"""\documentclass{article}\usepackage{graphicx,booktabs,array}\newcommand{\publication}{run/publication}
        \begin{document}\input{\publication/floats}\end{document}"""
    (tmp_path / "paper.tex").write_text(lines)
    done = subprocess.run(["pdflatex", "-halt-on-error", "paper.tex"], cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode == 0 and (tmp_path / "paper.pdf").stat().st_size > 10_000, done.stdout[-500:]


@pytest.mark.parametrize(
    ("problem", "solver"), [("lonely", "beta"), pytest.param("pendulum", "alpha", marks=pytest.mark.slow)]
)
def test_solvers_are_called_as_asked(results, capsys, problem, solver):
    """In figures and tables, not in the results; a name that is no solver's, or that two would have, is refused."""
    folder = results.folder / publication.FOLDER
    assert main(["figures", str(results.folder), "--only", problem, "--name", f"{solver}=ODE-GC & more"]) == 0
    text = (folder / problem / f"{problem}.tex").read_text(encoding="utf-8")
    assert r"{ODE-GC \& more}" in text and f"{{{solver}}}" not in text
    assert solver in read_results(results.folder).solvers
    capsys.readouterr()
    for given, words in (("alhpa=x", "there are "), ("alpha=beta", "two solvers are called 'beta'")):
        assert main(["figures", str(results.folder), "--name", given]) == 2
        assert words in capsys.readouterr().err


def test_captions_say_what_is_counted(results):
    """Where a panel has evaluations, and there alone."""
    made = {name: caption for p in results.variants for name, caption, _, _ in publication.list_figures(results, p)}
    assert "evaluation of the equations with its factorisation" in made["pendulum-work"]
    assert not any("factorisation" in caption for name, caption in made.items() if not name.endswith("-work"))


def test_captions_name_what_a_cross_is_and_whose_clock(results, tmp_path):
    """Where a figure has a false success, or CPU times, and there alone."""
    made = {name: caption for p in results.variants for name, caption, _, _ in publication.list_figures(results, p)}
    assert all(publication.CROSS in made[f"pendulum-recommended-{name}"] for name in ("energy", "laws"))
    assert publication.CROSS in made["pendulum-work"] and "on one machine." in made["pendulum-work"]
    for k in range(3):
        put(
            tmp_path, make_measured_record(f"aa0{k}", dt_s=0.1 / 2**k, position_error_max_m=0.01 / 4**k), make_swing(40)
        )
    write_text(tmp_path / "environment.json", '{"cpu": "a processor"}')
    found = read_results(tmp_path)
    made = {name: caption for name, caption, _, _ in publication.list_figures(found, found.variants[0])}
    assert "on one machine (a processor)." in made["pendulum-work"]
    assert made.keys() >= {"pendulum-convergence"} and not any(publication.CROSS in c for c in made.values())


def test_command_writes_figures_tables_and_captions(results, capsys):
    assert main(["figures", str(results.folder), "--only", "lonely"]) == 0
    folder = results.folder / publication.FOLDER
    told = json.loads((folder / "captions.json").read_text(encoding="utf-8"))
    assert told and all((folder / f).stat().st_size > 0 for t in told for f in t["files"])
    assert (folder / "lonely" / "lonely.tex").exists() and (folder / "lonely" / "lonely.csv").exists()
    page = (folder / "index.html").read_text(encoding="utf-8")
    linked = re.findall(r'(?:href|src)="([^"#]+)"', page)
    assert {f for t in told for f in t["files"]} < set(linked) and all((folder / f).exists() for f in linked)
    assert (folder / "overview.svg").exists() and "<script>" not in page
    assert ">pendulum</h2>" not in page and ">lonely</h2>" in page  # the problem that was asked for, and only that
    capsys.readouterr()
    assert main(["figures", str(results.folder), "--only", "nobody"]) == 2
    assert capsys.readouterr().err.startswith("error: no problem 'nobody'")


@pytest.mark.published
@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
@pytest.mark.skipif(not (BIN / "mbsbench").exists(), reason="the command mbsbench is not installed beside this Python")
def test_make_pictures_writes_those_of_the_pages(tmp_path):
    """A picture that nobody can make again goes stale; elsewhere nothing that is published changes."""
    copy, results, pictures = tmp_path / "mbsbench", tmp_path / "chain-run", tmp_path / "pictures"
    left_out = shutil.ignore_patterns(".*", "build", "local", "tests")
    shutil.copytree(TOP, copy, ignore=left_out)  # with kept machine code
    published = sorted((copy / "results" / "published" / "engines" / "runs").glob("*.json"))
    before = [(p.name, p.read_bytes()) for p in published]
    pictures.mkdir()
    (ready := tmp_path / "ready").touch()  # newer than the locks: nothing is installed
    for k, solver in enumerate(("alpha", "beta")):
        put(results, make_measured_record(f"{k:04x}", solver, problem="chain"), make_swing(40))
    given = {"RESULTS": results, "PICTURES": pictures, "VENV": tmp_path, "BIN": BIN, "READY": ready}
    make = ["make", "-C", str(copy), "pictures", *(f"{k}={v}" for k, v in given.items())]
    subprocess.run(make, check=True, capture_output=True, env={**os.environ, "PYTHONPATH": str(tmp_path)})
    pages = "".join((copy / name).read_text(encoding="utf-8") for name in ("README.md", "docs/judging.md"))
    shown = re.findall(r"!\[[^]]+\]\((?:docs/)?images/([^)]+)\)", pages)
    assert sorted(p.name for p in pictures.iterdir()) == sorted(shown)
    assert all("<svg" in p.read_text(encoding="utf-8") for p in pictures.iterdir())
    assert before and before == [(p.name, p.read_bytes()) for p in sorted(published[0].parent.glob("*.json"))]


def test_a_legend_is_smaller_than_its_plot(tmp_path):
    """Of fourteen lines with long names, the solvers are named: the plot is what is looked at."""
    for k in range(12):
        put(
            tmp_path,
            make_measured_record(f"{k:04x}", f"solver{k % 4}", dt_s=1e-3 * (k + 1), paper_label="a long label"),
            make_swing(40),
        )
    found = read_results(tmp_path)
    made = {name: draw for name, _, _, draw in publication.list_figures(found, found.variants[0])}
    with apply_style():
        drawn = made["pendulum-recommended-energy"]()
        FigureCanvasAgg(drawn).draw()
        (legend,), (ax,) = drawn.legends, drawn.axes
        assert legend.get_window_extent().height < ax.get_window_extent().height
        assert [t.get_text() for t in legend.get_texts()] == [
            *(f"solver{k} [a long label]" for k in range(4)),
            "limit 0.100 J",
        ]


def test_many_runs_are_parted_by_solver(tmp_path):
    """No figure has more lines than one can tell apart, where one solver does not have more."""
    runs = [make_measured_record(f"{k:04x}", f"solver{k // 4}") for k in range(32)]
    for c in runs:
        put(tmp_path, c, make_swing(20))
    results = read_results(tmp_path)
    found = publication.split_runs(results.runs)
    made = {name: caption for name, caption, _, _ in publication.list_figures(results, results.variants[0])}
    for k, part in enumerate(found, 1):  # a figure of some solvers says of which
        ends = f"figure {k} of {len(found)}: {part[0].record.solver} to {part[-1].record.solver}. "
        assert ends in made["pendulum-recommended-energy" if k == 1 else f"pendulum-recommended-{k}-energy"]
    assert sum(map(len, found)) == 32 and max(map(len, found)) <= publication.MOST
    assert all(
        len({c.record.solver for c in a} & {c.record.solver for c in b}) == 0
        for a in found
        for b in found
        if a is not b
    )
