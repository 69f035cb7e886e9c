"""Every page of judgements: escapes what it is given, needs only its files, is never empty, tells all readers."""

import json
import re
from itertools import pairwise

import pytest

from mbsbench.harness.results.judgements.files import add_code, format_judgement
from mbsbench.reports.model.results import read_results

from ..conftest import HOSTILE, put, record, series
from . import synthetic
from .conftest import PAGES, Outline, render

FILES = [file.name for file, _ in synthetic.FILES]


@pytest.mark.parametrize("name", PAGES)
def test_text_of_results_and_judgements_is_escaped(judged_pages, name):
    """Claims, solvers, messages, digests: all come from files, and files may attack."""
    html = judged_pages[name]
    assert "<script>alert" not in html
    assert HOSTILE in Outline(html).text or name == "solver-alpha.html"  # as text; a page of its own runs
    scripts = [a for t, a in Outline(html).tags if t == "script"]
    assert sum("src" not in a for a in scripts) <= 1  # the theme's


@pytest.mark.parametrize("name", PAGES)
def test_page_needs_only_files_beside_it(judged_run, judged_pages, name):
    """No address of a network; what is linked exists."""
    assert not re.search(r"https?:|//[a-z]+\.|@import", judged_pages[name])
    folder = judged_run.folder / "report"
    for tag, attributes in Outline(judged_pages[name]).tags:
        target = attributes.get("src") or attributes.get("href") or ""
        if tag in ("script", "img", "link") or target.startswith(("figures/", "runs/")):
            assert target.startswith("data:") or not target or (folder / target).is_file(), target


@pytest.mark.parametrize("name", PAGES)
def test_screen_readers_get_descriptions(judged_pages, name):
    """Tables have captions and scoped heads, drawings a description, headings their order, names are unique."""
    tags = Outline(judged_pages[name]).tags
    assert sum(t == "table" for t, _ in tags) == sum(t == "caption" for t, _ in tags)
    assert all(a.get("scope") in ("row", "col") for t, a in tags if t == "th")
    assert all(a.get("aria-label") for t, a in tags if t == "svg" or a.get("role") == "img")
    levels = [int(t[1]) for t, _ in tags if re.fullmatch(r"h[1-6]", t)]
    assert levels[0] == 1 and levels.count(1) == 1 and all(b - a <= 1 for a, b in pairwise(levels))
    names = [a["id"] for _, a in tags if "id" in a]
    assert len(names) == len(set(names))
    targets = [a["href"][1:] for t, a in tags if t == "a" and (a.get("href") or "").startswith("#")]
    assert set(targets) <= set(names)


@pytest.mark.parametrize("name", ["claims.html", "solver-alpha.html", "cost.html"])
@pytest.mark.parametrize("state", ["missing", "broken", "foreign"])
def test_without_a_judgement_the_page_names_the_command(tmp_path, name, state):
    """A reader who finds nothing is told how to get it."""
    put(tmp_path, record("aa01"), series(40))
    if state != "missing":
        (tmp_path / "judgement").mkdir()
        for file in FILES:
            text = "{" if state == "broken" else json.dumps({"something": "else"})
            (tmp_path / "judgement" / f"{file}.json").write_text(text)
    pages = render(read_results(tmp_path), [PAGES[name]])
    assert f"mbsbench judge {tmp_path.name}" in Outline(pages[name]).text


@pytest.mark.parametrize("judged", ["not yet", "of nothing"])
def test_no_page_is_empty_after_a_bench(tmp_path, judged):
    """What these results do not allow to judge is shown as published, marked; no link leads to an empty page."""
    put(tmp_path, record("aa01"), series(40))
    if judged == "of nothing":
        (tmp_path / "judgement").mkdir()
        for file in FILES:
            nothing = {"work": '{"points": []}', "claims": format_judgement(add_code((), synthetic.CODE))}
            (tmp_path / "judgement" / f"{file}.json").write_text(nothing.get(file, "[]"))
    pages = render(read_results(tmp_path), [PAGES[n] for n in ("claims.html", "solver-alpha.html")])
    for html in (pages["claims.html"], pages["solver-alpha.html"]):
        assert "As published, from other results." in Outline(html).text and "Not judged" not in Outline(html).text
    assert pages["claims.html"].count("data-item") > 50


@pytest.mark.parametrize("file", FILES)
def test_a_file_of_another_shape_is_refused_in_a_line(tmp_path, file):
    """What is read is what is written: a row of an older version is named with its place, not shown in part."""
    put(tmp_path, record("aa01"), series(40))
    (tmp_path / "judgement").mkdir()
    rows = [{"id": "a", "run": "aa01", "words": "as said"}]
    text = json.dumps({"points": rows, "profile": rows} if file == "work" else rows)
    (tmp_path / "judgement" / f"{file}.json").write_text(text)
    pages = render(read_results(tmp_path), PAGES.values())
    text = " ".join(Outline(html).text for html in pages.values())
    assert f"judgement/{file}.json: " in text and ("unknown key" in text or "older version" in text)


def test_a_run_without_runs_has_its_pages_too(tmp_path):
    (tmp_path / "runs").mkdir()
    pages = render(read_results(tmp_path), PAGES.values())
    assert "no finished run" in Outline(pages["atlas.html"]).text
