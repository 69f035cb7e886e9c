"""Every page of judgements is never empty, and says what it lacks; ``test_site`` holds the laws of all pages."""

import json

import pytest

from mbsbench.harness.results.judgements.files import add_code, format_judgement
from mbsbench.reports.model.results import read_results
from mbsbench.tests.factories import make_measured_record, make_swing

from ..conftest import put
from ..outline import Outline
from . import synthetic
from .conftest import PAGES, render

FILES = [file.name for file, _ in synthetic.FILES]


@pytest.mark.parametrize("name", ["claims.html", "solver-alpha.html", "cost.html"])
@pytest.mark.parametrize("state", ["missing", "broken", "foreign"])
def test_without_a_judgement_the_page_names_the_command(tmp_path, name, state):
    """A reader who finds nothing is told how to get it."""
    put(tmp_path, make_measured_record("aa01"), make_swing(40))
    if state != "missing":
        (tmp_path / "judgement").mkdir()
        for file in FILES:
            text = "{" if state == "broken" else json.dumps({"something": "else"})
            (tmp_path / "judgement" / f"{file}.json").write_text(text)
    pages = render(read_results(tmp_path), [PAGES[name]])
    assert f"mbsbench judge {tmp_path.name}" in Outline(pages[name]).plain


@pytest.mark.parametrize("judged", ["not yet", "of nothing"])
def test_no_page_is_empty_after_a_bench(tmp_path, judged):
    """Judgements that these results do not allow are shown as published, marked; no link leads to an empty page."""
    put(tmp_path, make_measured_record("aa01"), make_swing(40))
    if judged == "of nothing":
        (tmp_path / "judgement").mkdir()
        for file in FILES:
            none = format_judgement(add_code((), synthetic.CODE))
            nothing = {"work": '{"points": []}', "claims": none, "field": none}
            (tmp_path / "judgement" / f"{file}.json").write_text(nothing.get(file, "[]"))
    pages = render(read_results(tmp_path), [PAGES[n] for n in ("claims.html", "solver-alpha.html")])
    for html in (pages["claims.html"], pages["solver-alpha.html"]):
        assert "As published, from other results." in Outline(html).plain and "Not judged" not in Outline(html).plain
    assert pages["claims.html"].count("data-item") > 50


def check_files_of_another_shape(folder, files):
    """Write judgements with rows that nobody writes now, and find each named on the pages."""
    put(folder, make_measured_record("aa01"), make_swing(40))
    (folder / "judgement").mkdir()
    rows = [{"id": "a", "run": "aa01", "words": "as said"}]
    for file in files:
        text = json.dumps({"points": rows, "profile": rows} if file == "work" else rows)
        (folder / "judgement" / f"{file}.json").write_text(text)
    pages = render(read_results(folder), PAGES.values())
    text = " ".join(Outline(html).plain for html in pages.values())
    for file in files:
        said = text.partition(f"judgement/{file}.json: ")[2][:300]
        assert "unknown key" in said or "older version" in said, (file, said)


def test_files_of_another_shape_are_refused_in_a_line_each(tmp_path):
    """Rows are read as they were written: a row of an older version is named with its place, not shown in part."""
    check_files_of_another_shape(tmp_path, FILES)


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_a_file_of_another_shape_is_refused_in_a_line(tmp_path, file):
    """Also where it is the only one."""
    check_files_of_another_shape(tmp_path, [file])


def test_a_run_without_runs_has_its_pages_too(tmp_path):
    (tmp_path / "runs").mkdir()
    pages = render(read_results(tmp_path), PAGES.values())
    assert "no finished run" in Outline(pages["atlas.html"]).plain
