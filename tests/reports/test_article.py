"""The article: no number without a source, sentences that the results bear out, one source for two formats."""

import os
import re
import shutil
import sys

import pytest

from mbsbench.harness.results.environment import ROOT

pytestmark = pytest.mark.beyond_core


@pytest.fixture(scope="module")
def article():
    sys.path.insert(0, str(ROOT / "docs" / "article"))
    import build_article

    sys.path.pop(0)
    return build_article


@pytest.fixture(scope="module")
def built(article, tmp_path_factory):
    return article.build(tmp_path_factory.mktemp("article"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("It fails at 32 s.", "'32' is typed and has no source"),
        ("Holds in seven runs.", "'seven' is typed"),
        ("The year is 2021.", "'2021.' is typed"),
        (r"The step is $\Delta t = 0.01$.", "holds a typed number"),
        ("It took {{ 3.5 }} s.", "the placeholder types 3.5"),
        ('It took {{ "3 s" }}.', "the placeholder types '3 s'"),
        ('It took {{ 2 * claim("1-one-step").paper.holds }} s.', "the placeholder types 2"),
        ('It took {{ plural(5, "second") }}.', "the placeholder types 5"),
        ("{% set n = 5 %}It took {{ n }} s.", "no variable may hold a number"),
        ("It took {{ runtime }} s.", "'runtime' is not in published results"),
        ('It holds: {{ claim("no-such").paper.holds }}.', "the claim 'no-such': published results hold 0 of it"),
        ('It holds: {{ claim("1-one-step").paper.decision }}.', "None"),
        ('It holds: {{ share("6-gc-planar", direction="none") }}.', "published results hold 0 of it"),
        ('It holds: {{ share("12-joint-A") }}.', "has no settings to count"),
        ('{% assert judged_none("1-one-step") %}It is false.', "contradict the sentence"),
        ('{% assert claim("1-one-step").verdict == "not reproduced" %}It is false.', "contradict the sentence"),
        ("Line one.\n\n{{ open", "article.j2:3: "),
    ],
)
def test_what_has_no_source_fails_in_one_line(article, text, words):
    """The same text with its source named, or without the number, would be built."""
    with pytest.raises(article.Fault, match=re.escape(words)) as fault:
        article.fill(text)
    assert str(fault.value).startswith("article.j2:") and "\n" not in str(fault.value)


def test_a_table_or_figure_without_data_fails(article):
    with pytest.raises(article.Fault, match="no figure 'none' is drawn"):
        article.blocks("@figure none\nA caption.")


@pytest.mark.parametrize(
    "text",
    [
        "See Sect. 5.2, Figs. 2 and 3, Eq. (79) and Eqs. (31) and (96).",
        "ODE-45 and index 3 in 2022.",
        r"The norm of $\lambda_2^{-1}$.",
        "The solver `ida_index1`.",
        '{{ claim("1-one-step").paper.settings }}',
    ],
)
def test_references_names_and_placeholders_pass(article, text):
    article.fill(text)


@pytest.mark.published
def test_the_page_holds_every_table_and_figure(article, built):
    page, text = (p.read_text(encoding="utf-8") for p in built[:2])
    assert not re.search(r"\{\{|\{%|@table|@figure", page + text)
    for name in article.data.FIGURES:
        assert f'src="{name}.svg"' in page and f"{{{name}.pdf}}" in text and (built[0].parent / f"{name}.svg").is_file()
    assert page.count("<table>") == text.count(r"\begin{tabular}") == len(article.data.TABLES)


@pytest.mark.published
def test_it_says_what_the_published_verdicts_say(article, built):
    """Another route to the first numbers: counted from the file of verdicts."""
    import json

    claims = json.loads((ROOT / "results" / "published" / "claims.json").read_text(encoding="utf-8"))["claims"]
    own = [c for c in claims if c["kind"] == "result" and c["paper"] and not article.data.OURS.match(c["id"])]
    refuted = sum(c["paper"]["verdict"] == "not reproduced" for c in own)
    page = built[0].read_text(encoding="utf-8")
    assert f"Of {len(own)} claims of the paper" in page and f"with some of these choices, {refuted} with none" in page


@pytest.mark.published
def test_it_says_what_the_published_contest_and_motions_say(article, built):
    """Counted over solvers of the catalogue instead of by problem; where an engine leads stands first."""
    import json

    from mbsbench.harness.catalogue.registry import engines

    contests, chaos = (
        json.loads((ROOT / "results" / "published" / name).read_text(encoding="utf-8"))
        for name in ("engines/contests.json", "chaos.json")
    )
    leads = {}
    for one in contests["contests"]:
        costs = {
            who: pair["best"]["cpu_s"]
            for who, pair in one["pairs"].items()
            if pair["best"]["error"] is not None and pair["best"]["error"] <= contests["target"]
        }
        leads[one["problem"]] = min(costs, key=costs.get).split()[0] in engines()
    page = built[0].read_text(encoding="utf-8")
    assert f"cheapest code on {sum(leads.values())} of {len(leads)} problems" in page
    rows = [row[0].replace(" ", "_") for row in article.data.engine_table()[1]]
    assert [leads[name] for name in rows] == sorted(leads.values(), reverse=True)
    found = [r["shadow"].get("until_s") == r["t_reached_s"] == 20.0 for r in chaos["runs"].values()]
    assert f"For {sum(found)} of {len(found)} codes" in page


@pytest.mark.published
def test_latex_takes_it(built):
    """Three to five pages without a line that runs over; in CI the compiler must be there."""
    if not shutil.which("pdflatex"):
        assert not os.environ.get("CI"), "CI installs pdflatex: make tex"
        pytest.skip("needs pdflatex: make tex")
    log = built[2].with_suffix(".log").read_text(encoding="latin-1")
    (pages,) = re.findall(r"Output written on article\.pdf \((\d+) pages", log)
    assert 3 <= int(pages) <= 5 and "Missing character" not in log and "Overfull" not in log
