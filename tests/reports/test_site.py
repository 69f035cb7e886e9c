"""The site holds every run and every reason, escapes what it is given, and needs nothing but itself."""

import dataclasses
import json
import re
from html import unescape
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results.environment import ROOT
from mbsbench.reports import site
from mbsbench.reports.model.glossary import GLOSSARY, format_markdown, term
from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages import base
from mbsbench.reports.pages.base import Page, Site
from mbsbench.solvers.gc_weak_form import GcWeakForm
from mbsbench.tests.factories import make_measured_record, make_swing, run_suite_text

from .conftest import HOSTILE, every_kind, put
from .outline import Outline
from .pages.synthetic import judge

ATTACKED = ("claims.html", "cost.html", "atlas.html")


def pages_of(report: Path) -> dict[str, str]:
    """Every page by its path from the report folder."""
    return {p.relative_to(report).as_posix(): p.read_text(encoding="utf-8") for p in report.rglob("*.html")}


@pytest.fixture(scope="module")
def pages(built):
    return pages_of(built[0] / "report")


@pytest.fixture(scope="module", params=["as published", "judged"])
def report(request, built, tmp_path_factory):
    """The folder of pages; judged by files that attack, too."""
    if request.param == "as published":
        return built[0] / "report"
    folder = tmp_path_factory.mktemp("judged") / "run"
    judge(folder, [r.settings_id for r in every_kind(folder)])
    return site.build_report(folder).parent


def test_no_template_shows_its_own_syntax():
    """Half a tag is text to Jinja; where braces are meant, in scripts and styles, no two stand together."""
    templates = sorted(Path(site.__file__).parent.rglob("*.html"))
    assert len(templates) > 10
    for path in templates:
        rest = re.sub(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        assert not re.search(r"\{\{|\}\}|\{%|%\}", rest), path.name


def test_every_run_problem_and_solver_has_a_page(built, pages):
    folder, records, _ = built
    results = read_results(folder)
    assert {f"runs/{r.run_id}.html" for r in records} <= set(pages)
    assert {f"problem-{p.slug}.html" for p in results.variants} <= set(pages)
    assert sum(name.startswith("solver-") for name in pages) == len(results.solvers)


def test_every_run_says_how_it_ended_and_why(built, pages):
    """On its own page, on its problem's and on its solver's."""
    for r in built[1]:
        page = pages[f"runs/{r.run_id}.html"]
        words = {"wrong": "✗", "refused": "⊘", "success": "✓"}.get(r.status, "★")
        assert words in page
        if r.message:
            assert r.message.split(HOSTILE)[0] in Outline(page).text
    assert "[IDA ERROR]" in pages["runs/dd01.html"] and "signal 11" in pages["runs/ee01.html"]
    problem, solver = pages["problem-pendulum.html"], pages["solver-gamma.html"]
    for reason in ("rank 325 of 400", "|phi| is large", "stuck"):
        assert reason in problem
    assert "rank 325 of 400" in solver


def test_command_to_reproduce_is_on_the_page_of_a_run(pages):
    assert "mbsbench solve pendulum alpha" in Outline(pages["runs/aa01.html"]).text


def test_wrong_is_loud_wherever_it_shows(built, pages):
    """A wrong success looks like a success unless it is marked."""
    for name in ("index.html", "problem-pendulum.html", "solver-beta.html", "runs/bb01.html"):
        assert 'class="mark wrong"' in pages[name], name


def test_text_of_results_and_judgements_is_escaped(report, built):
    """Messages, standard error, plugins, claims, digests come from outside; a page's only own script is the theme."""
    pages = pages_of(report)
    for name, html in pages.items():
        assert "<script>alert" not in html, name
        own = [a for t, a in Outline(html).tags if t == "script" and "src" not in a]
        assert len(own) == 1, name
    for name in (
        "mechanisms.html",
        "runs/gg01.html",
        "runs/dd01.html",
        *(ATTACKED if report.parent != built[0] else ()),
    ):
        assert HOSTILE in Outline(pages[name]).text, name


def test_data_files_are_scripts_that_hostile_text_cannot_leave(built):
    """Strict JSON after the assignment; nothing in it can end a script or a line."""
    for path in (built[0] / "report" / "data").glob("*.js"):
        text = path.read_text(encoding="utf-8")
        assert json.loads(text[text.index(" = ") + 3 : text.rindex(";")]) is not None
        assert "</" not in text and "\u2028" not in text


def test_every_address_is_of_a_file_in_the_folder(report):
    """No network, no dead link, no anchor that is not there."""
    pages = pages_of(report)
    assert not [n for n in (*ATTACKED, "solver-alpha.html") if re.search(r"https?:|//[a-z]+\.|@import", pages[n])]
    for name, html in pages.items():
        ids = (
            {n: {a["id"] for _, a in Outline(t).tags if "id" in a} for n, t in pages.items()}
            if name == "index.html"
            else {}
        )
        for tag, attributes in Outline(html).tags:
            for key in ("src", "href", "action", "poster"):
                value = attributes.get(key)
                if not value or value.startswith("data:"):
                    continue
                assert not re.match(r"[a-z]+:|//", value), (name, tag, value)
                path, _, anchor = value.partition("#")
                target = (report / name).parent / unquote(path.partition("?")[0]) if path else report / name
                assert target.exists(), (name, value)
                if anchor and ids:
                    assert anchor in ids[target.resolve().relative_to(report.resolve()).as_posix()], (name, value)


def test_screen_readers_get_descriptions(report):
    """Tables have captions and scoped heads, headings their order, names are unique, boxes scroll by the keyboard."""
    for name, html in pages_of(report).items():
        tags = Outline(html).tags
        assert sum(t == "table" for t, _ in tags) == sum(t == "caption" for t, _ in tags), name
        assert all(a.get("scope") in ("row", "col") for t, a in tags if t == "th"), name
        levels = [int(t[1]) for t, _ in tags if re.fullmatch(r"h[1-6]", t)]
        assert levels[0] == 1 and levels.count(1) == 1, name
        for a, b in pairwise(levels):
            assert b - a <= 1, (name, levels)
        names = [a["id"] for _, a in tags if "id" in a]
        assert len(names) == len(set(names)), name
        assert all("tabindex" in a for _, a in tags if a.get("class") == "scroll"), name
        assert all(a.get("aria-label") for t, a in tags if t == "svg" or a.get("role") == "img"), name
        targets = [a["href"][1:] for t, a in tags if t == "a" and (a.get("href") or "").startswith("#")]
        assert set(targets) <= set(names), name


def test_every_page_says_where_its_numbers_come_from(pages):
    """In full at the top, in a line with the way there below: a results folder has thousands of runs."""
    for name, html in pages.items():
        text, brief = Outline(html).text, 'id="provenance"' not in html
        for word in ("f00d" * 3, "dirty", "a processor", "Python", "3.11"):
            assert word in text, (name, word)
        if brief:
            assert "numpy 2.4" in text and "index.html#provenance" in html, name
            continue
        for word in ("f00d" * 10, "openblas 0.3", "1 thread(s)", "dt 0.01, 0.005 s"):
            assert word in text, (name, word)
    assert "numpy 2.4" in Outline(pages["index.html"]).text
    assert all('id="provenance"' in pages[name] for name in ("index.html", "problem-pendulum.html", "solver-beta.html"))


def test_the_menu_is_seven_pages(pages):
    """Certificates are on the solvers' pages."""
    links = [a["href"] for t, a in Outline(pages["index.html"].partition("</nav>")[0]).tags if t == "a"]
    own = ["index.html", "mechanisms.html", "solvers.html", "claims.html", "cost.html", "atlas.html", "method.html"]
    assert links[1:] == own


def test_only_the_page_itself_is_current_in_the_navigation(pages):
    for name, html in pages.items():
        current = [a["href"] for t, a in Outline(html).tags if t == "a" and a.get("aria-current") == "page"]
        assert all(href == name for href in current), name


def test_a_run_costs_few_bytes(built, pages):
    """A mission has three thousand: what is the same for all is said elsewhere. Texts of its own come on top."""
    plain = pages["runs/aa01.html"].encode()
    assert len(plain) < 3000
    meanings = (built[0] / "report" / "data" / "meanings.js").read_text(encoding="utf-8")
    for word in re.findall(r"<dt>([^<]*)", pages["runs/aa01.html"].partition("data-meanings")[2]):
        assert word.startswith("counted: ") or json.dumps(unescape(word), ensure_ascii=False) in meanings, word


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", ["nothing", "one", "only failures"])
def test_poor_runs_have_a_site_too(tmp_path, kind):
    """No run, no environment, no series: the pages say so and do not fail."""
    (tmp_path / "runs").mkdir()
    if kind == "one":
        put(tmp_path, make_measured_record("aa01"), make_swing(40))
    if kind == "only failures":
        put(tmp_path, make_measured_record("cc01", "gamma", "refused", message="no", t_reached_s=float("nan")))
        put(tmp_path, make_measured_record("ee01", "beta", "crashed", message="", t_reached_s=float("nan")))
    html = site.build_report(tmp_path).read_text(encoding="utf-8")
    words = {"nothing": "no finished run", "one": "1 solver on 1 mechanism", "only failures": "crashed, without a"}
    assert words[kind] in html
    assert "environment.json is missing" in html


def test_damaged_files_are_named(tmp_path):
    """Unreadable files are not silently left out."""
    put(tmp_path, make_measured_record("aa01"), make_swing(40))
    (tmp_path / "runs" / "zz99.json").write_text("{")
    put(tmp_path, make_measured_record("bb01"), make_swing(40))
    (tmp_path / "series" / "bb01.npz").write_bytes(b"cut off")
    html = site.build_report(tmp_path).read_text(encoding="utf-8")
    assert "Left out: zz99.json" in html and "Left out: bb01.json" in html
    assert not (tmp_path / "report" / "runs" / "bb01.html").exists()


def test_a_new_report_keeps_no_page_of_an_earlier_one(tmp_path):
    """Pages of runs that are gone would be taken for this run's."""
    put(tmp_path, make_measured_record("aa01"), make_swing(40))
    put(tmp_path, make_measured_record("aa02", dt_s=0.005), make_swing(40))
    site.build_report(tmp_path)
    (tmp_path / "runs" / "aa02.json").unlink()
    (tmp_path / "report" / "figures").mkdir(exist_ok=True)
    (tmp_path / "report" / "figures" / "kept.svg").write_text("")
    site.build_report(tmp_path)
    assert not (tmp_path / "report" / "runs" / "aa02.html").exists()
    assert (tmp_path / "report" / "figures" / "kept.svg").exists()  # others put figures there


def test_two_pages_cannot_have_one_name(tmp_path):
    put(tmp_path, make_measured_record("aa01"))
    here = Site(read_results(tmp_path), ConfinedPath(tmp_path))
    here.write(Page("One", "x.html"), "method.html")
    with pytest.raises(ValueError, match="two pages want to be"):
        here.write(Page("Two", "x.html"), "method.html")


def test_page_modules_are_found_and_late_ones_come_last():
    """No list to edit: what has a ``write`` is a page; runs need what problems left for them."""
    names = [module.__name__ for module in base.load_page_modules()]
    assert {
        "mbsbench.reports.pages.runs.overview",
        "mbsbench.reports.pages.runs.problems",
        "mbsbench.reports.pages.runs.runs",
    } <= set(names)
    assert names.index("mbsbench.reports.pages.runs.runs") > names.index("mbsbench.reports.pages.runs.problems")


TINY = """
name = "tiny"
[[runs]]
label = "recommended"
problem = "spherical_pendulum"
parameters = { t_end = 0.3 }
solver = "gc_weak_form"
dt = [0.02, 0.01]
"""


def test_real_run_has_a_report(tmp_path, capsys):
    """Run, then ``report``: every run has its page, with plots, tables and its command."""
    folder = tmp_path / "run"
    loaded, _ = run_suite_text(folder, TINY, 1, plugins=())
    assert main(["report", str(folder)]) == 0
    assert "index.html" in capsys.readouterr().out
    assert main(["report", str(folder), "--out", "x"]) == 2
    assert "--out needs two results folders" in capsys.readouterr().err
    report = folder / "report"
    assert len(loaded.records) == 2
    for r in loaded.records:
        assert "mbsbench solve spherical_pendulum" in (report / "runs" / f"{r.run_id}.html").read_text("utf-8")
    problem = next(report.glob("problem-*.html")).read_text(encoding="utf-8")
    assert "observed order" not in problem and 'data-plot="energy"' in problem
    assert list((report / "tables").glob("*.csv")) and list((report / "data").glob("plots-problem-*.js"))


def test_the_page_in_docs_is_the_table_that_the_reports_use():
    """Made anew by ``python -m mbsbench.reports.model.glossary``."""
    assert format_markdown() in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")


def test_every_status_and_verdict_has_an_entry_of_one_sentence():
    """A reader meets them on every page."""
    assert {str(s) for s in Status} | {
        "reproduced",
        "not reproduced",
        "reproduced if",
        "cannot be told",
    } <= GLOSSARY.keys()
    assert all(text.endswith(".") and "\n" not in text for text in GLOSSARY.values())


def test_words_of_the_paper_s_method_and_of_forces_have_an_entry():
    """They are options of its solvers, and columns; a reader meets them in help, plots and verdicts."""
    options = {f.name for f in dataclasses.fields(GcWeakForm)}
    words = {"gauge", "mu0", "sigma0", "direction", "estimate"}
    assert words <= options and {*words, "reaction", "joint force", "borderline"} <= GLOSSARY.keys()


def test_every_term_of_a_template_is_in_the_glossary():
    """A tooltip without a meaning would stop the report."""
    used = set()
    for path in (ROOT / "reports" / "templates").glob("*.html"):
        used |= set(re.findall(r"""term\(["']([^"']+)["']""", path.read_text(encoding="utf-8")))
    assert used and used <= GLOSSARY.keys()


def test_texts_are_escaped():
    """They stand in an attribute."""
    assert term("law", "<b>") == f'<abbr title="{GLOSSARY["law"]}">&lt;b&gt;</abbr>'
