"""The page holds every cell and every reason, escapes what it is given, and needs nothing but itself."""

import re
from html.parser import HTMLParser
from itertools import pairwise

import pytest

from reports import site
from tests.reports.conftest import put, record, series


class Outline(HTMLParser):
    """Tags with attributes, and text outside of script and style."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.inside = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self.inside.append(tag)

    def handle_endtag(self, tag):
        if self.inside and self.inside[-1] == tag:
            self.inside.pop()

    def handle_data(self, data):
        if not self.inside:
            self.text.append(data)


def test_every_cell_has_a_row_and_every_failure_its_reason(built):
    _, records, html = built
    for r in records:
        assert f'id="cell-{r.cell}"' in html
        if r.status != "success":
            failures = html.split('id="failures"')[1].split("</section>")[0]
            assert f'href="#cell-{r.cell}"' in failures
    for reason in (
        "rank 325 of 400",
        "signal 11",
        "the wall limit of 60 s was reached",
        "|phi| is large",
        "[IDA ERROR]",
    ):
        assert reason in html


def test_text_of_results_is_escaped(built):
    """Messages, standard error, names of plugins: all come from outside."""
    _, _, html = built
    page = Outline(html)
    assert [t for t, _ in page.tags].count("script") == 1
    assert 'alert("1")' in "".join(page.text)  # it is there, as text
    assert "<script>alert" not in html


def test_page_needs_nothing_but_itself(built):
    """No address but names of its own parts, inlined data and files beside it."""
    folder, _, html = built
    assert not re.search(r"https?:|//[a-z]+\.|@import|xmlns", html)
    for tag, attributes in Outline(html).tags:
        for name in ("src", "href", "action", "poster", "data"):
            value = attributes.get(name)
            if value is None:
                continue
            assert value.startswith(("#", "data:", "figures/", "tables/")), (tag, name, value)
            if value.startswith(("figures/", "tables/")):
                assert (folder / "report" / value).is_file()


def test_names_on_the_page_are_unique_and_links_lead_somewhere(built):
    _, _, html = built
    tags = Outline(html).tags
    names = [a["id"] for _, a in tags if "id" in a]
    assert len(names) == len(set(names))
    for _, a in tags:
        target = a.get("href") or ""
        if target.startswith("#"):
            assert target[1:] in names


def test_readers_without_eyes_are_told(built):
    """Every table has a caption and scoped heads, every figure a description, every heading its place."""
    _, _, html = built
    tags = Outline(html).tags
    assert sum(t == "table" for t, _ in tags) == sum(t == "caption" for t, _ in tags)
    assert all(a.get("scope") in ("row", "col") for t, a in tags if t == "th")
    figures = [a for t, a in tags if a.get("class") == "plot"]
    assert figures and all(a["role"] == "img" and len(a["aria-label"]) > 30 for a in figures)
    levels = [int(t[1]) for t, _ in tags if re.fullmatch(r"h[1-6]", t)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))


def test_matrix_has_no_blank(built):
    """A number, a reason, or 'not run'."""
    _, _, html = built
    for matrix in re.findall(r'<table class="matrix">.*?</table>', html, re.DOTALL):
        for entry in re.findall(r"<td.*?</td>", matrix, re.DOTALL):
            assert Outline(entry).text and "".join(Outline(entry).text).strip()


def test_provenance_is_on_the_page(built):
    _, _, html = built
    for word in ("f00d" * 10, "dirty", "a processor", "openblas 0.3", "1 thread(s)", "numpy 2.4", "dt 0.01, 0.005 s"):
        assert word in html


def test_wrong_success_is_said_first(built):
    _, _, html = built
    text = "".join(Outline(html).text)
    assert text.index("claimed success although") < text.index("Solver by problem")


@pytest.mark.parametrize("kind", ["nothing", "one", "only failures"])
def test_poor_runs_have_a_page_too(tmp_path, kind):
    """No cell, no environment, no series: the page says so and does not fail."""
    (tmp_path / "cells").mkdir()
    if kind == "one":
        put(tmp_path, record("aa01"), series(40))
    if kind == "only failures":
        put(tmp_path, record("cc01", "gamma", "refused", message="no", t_reached_s=float("nan")))
        put(tmp_path, record("ee01", "beta", "crashed", message="", t_reached_s=float("nan")))
    html = site.build(tmp_path).read_text(encoding="utf-8")
    words = {"nothing": "no finished cell", "one": "1 cell on 1 problem", "only failures": "crashed, without a message"}
    assert words[kind] in html
    assert "environment.json is missing" in html


def test_damaged_file_is_named(tmp_path):
    """What cannot be read is not silently left out."""
    put(tmp_path, record("aa01"), series(40))
    (tmp_path / "cells" / "zz99.json").write_text("{")
    assert "Left out: zz99.json" in site.build(tmp_path).read_text(encoding="utf-8")
