"""Figures and tables for papers: journal widths, fonts inside, LaTeX and CSV with the same numbers."""

import csv
import io
import json
import re

import pytest

from mbsbench.harness.__main__ import main
from mbsbench.reports.model.reading import read_run
from mbsbench.reports.publication import build, figures, tables
from mbsbench.reports.publication.style import DOUBLE, SINGLE

from ..conftest import every_kind, put, record, series

NUMBER = re.compile(r"\$(-?[\d.]+)(?:\\,(\d+))*(?:\\times 10\^\{(-?\d+)\})?\$")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hand-made")
    every_kind(folder)
    put(folder, record("ab12", "alpha", dt_s=0.0025, energy_drift_max_J=1.23456e-7), series(600, size=1e-7))
    return read_run(folder)


def value(latex: str) -> float | None:
    """What a reader takes a LaTeX number for; None for text."""
    plain = latex.strip().replace(r"\,", "")
    found = NUMBER.fullmatch(plain)
    return float(f"{found[1]}e{found[3] or 0}") if found else None


def test_latex_and_csv_have_the_same_numbers(run):
    """Cell by cell, digit by digit: both come from one rounding."""
    posing = max(run.posings, key=lambda p: len(p.cells))
    latex = tables.latex_of(posing.title, posing.cells)
    rows = [line.removesuffix(r" \\").split(" & ") for line in latex.splitlines() if line.endswith(r"\\")][1:]
    plain = list(csv.reader(io.StringIO(tables.csv_of(posing.cells))))[1:]
    compared = 0
    assert len(rows) == len(plain) == len(posing.cells)
    for a, b in zip(rows, plain, strict=True):
        assert len(a) == len(b)
        for shown, written in zip(a, b, strict=True):
            if shown.strip() == "--":
                assert written == ""
            elif (number := value(shown)) is not None:
                assert number == float(written), (shown, written)
                compared += 1
    assert compared > 5 * len(rows) / 2


def test_latex_is_balanced_and_harmless(run):
    """Braces close, dollars pair, every row has as many columns, nothing hostile is a command."""
    for posing in run.posings:
        lines = [k for k in tables.latex_of(posing.title, posing.cells).splitlines() if not k.startswith("%")]
        text = "\n".join(lines)
        body = re.sub(r"\\[\\{}$&%#_]", "", text)
        assert body.count("{") == body.count("}")
        assert [k[: k.index("{")] for k in lines if "{tabular}" in k] == [r"\begin", r"\end"]
        assert all(re.sub(r"\\\$", "", k).count("$") % 2 == 0 for k in lines)
        rows = [re.sub(r"\\&", "", k) for k in lines if k.endswith(r"\\")]
        columns = re.search(r"\\begin\{tabular\}\{([lr]+)\}", text)[1]
        assert {k.count("&") for k in rows} == {len(columns) - 1}
        assert r"\frac" not in text and "<script>" not in text


def test_widths_are_those_of_a_journal(run):
    assert 84.0 <= SINGLE * 25.4 <= 90.0 and 174.0 <= DOUBLE * 25.4 <= 180.0
    posing = next(p for p in run.posings if p.title == "pendulum")
    made = {f.name: f for f in build._figures(run, posing)}
    assert {"pendulum-soundest-energy", "pendulum-soundest-constraints", "pendulum-soundest-step", "pendulum-work",
            "pendulum-soundest-laws"} <= set(made)  # fmt: skip
    folder = run.folder / "widths"
    for name in ("pendulum-soundest-constraints", "pendulum-work"):
        (pdf,) = build.save(made[name].draw, folder, name, ("pdf",))
        box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", pdf.read_bytes())
        assert float(box[1]) == pytest.approx(made[name].width * 72.0, abs=0.1)
        assert b"/FontFile2" in pdf.read_bytes()


def test_command_writes_figures_tables_and_captions(run, capsys):
    assert main(["figures", str(run.folder), "--only", "lonely"]) == 0
    folder = run.folder / build.FOLDER
    told = json.loads((folder / "captions.json").read_text(encoding="utf-8"))
    assert told and all((folder / f).stat().st_size > 0 for t in told for f in t["files"])
    assert (folder / "lonely.tex").exists() and (folder / "lonely.csv").exists()
    capsys.readouterr()
    assert main(["figures", str(run.folder), "--only", "nobody"]) == 2
    assert capsys.readouterr().err.startswith("error: no problem 'nobody'")


def test_many_cells_are_parted_by_solver(tmp_path):
    """No figure has more lines than one can tell apart, where one solver does not have more."""
    cells = [record(f"{k:04x}", f"solver{k // 4}") for k in range(32)]
    for c in cells:
        put(tmp_path, c)
    found = build.parts(read_run(tmp_path).cells)
    assert sum(map(len, found)) == 32 and max(map(len, found)) <= build.MOST
    assert all(len({c.record.solver for c in a} & {c.record.solver for c in b}) == 0
               for a in found for b in found if a is not b)  # fmt: skip
    assert figures.WRAP < 80
