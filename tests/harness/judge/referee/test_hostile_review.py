"""Objections that the paper's authors would raise, each answered by runs that are in a claim's map or are made here."""

import textwrap
from functools import cache
from typing import Any

import pytest

from mbsbench.harness.base.files import parse_toml
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.judge.referee.claims.bands import Band
from mbsbench.harness.judge.referee.claims.frame import are_equal, read_dimensions, select_runs
from mbsbench.harness.judge.referee.claims.measures import MEASURES, evaluate
from mbsbench.harness.judge.referee.claims.register import REGISTER, read_register
from mbsbench.harness.judge.referee.judge import list_tried_runs
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.run.job import Job
from mbsbench.tests.factories import run_here

PATH = REGISTER.with_name("objections.toml")
OBJECTIONS: list[dict[str, Any]] = parse_toml(PATH.read_text(encoding="utf-8"), PATH.name)["objections"]
CLAIMS = {c.id: c for c in read_register().claims}
PAGE = ROOT / "docs" / "decisions" / "objections.md"
BAND = {"at_least": float("-inf"), "at_most": float("inf")}


def named(key: str) -> Any:
    """A parameter for each objection that has ``key``, under its id."""
    return pytest.mark.parametrize("given", [pytest.param(o, id=o["id"]) for o in OBJECTIONS if key in o])


@cache
def places():
    return [read_dimensions(s) for s in list_tried_runs()]


@named("runs")
def test_runs_that_answer_are_in_the_map_of_the_claim(given):
    """Else the verdict would not depend on what is objected to; the number named is one that the claim reads."""
    for run in given["runs"]:
        claim, settings = CLAIMS[run["claim"]], run["settings"]
        own = select_runs(places(), claim.map.over)
        assert any(all(are_equal(p.dimensions.get(k), v) for k, v in settings.items()) for p in own), run
        assert run["number"] in {t.metric for t in claim.tests}, run


@named("suite")
def test_small_runs_answer(given, tmp_path):
    """Each run of the objection has the numbers that the answer says."""
    store.create_folder(tmp_path)
    records = [run_here(Job(spec, tmp_path)) for spec in parse_suite(given["suite"], "review", given["id"]).specs]
    assert records
    for record in records:
        series = store.read_run_series(tmp_path, record)
        for test in given["tests"]:
            band, metric = BAND | {k: v for k, v in test.items() if k in BAND}, test["metric"]
            arguments = {k: v for k, v in test.items() if k in MEASURES[metric].takes}
            value = evaluate(metric, record, series, arguments)
            assert Band(band["at_least"], band["at_most"]).holds(value), (record.case, metric, value)


def page() -> str:
    """The page, with its list made from the file."""
    rows = []
    for o in OBJECTIONS:
        rows += textwrap.wrap(
            f"**{o['objection']}** {o['answer']}",
            98,
            initial_indent="- ",
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    head = PAGE.read_text(encoding="utf-8").split("\n- **", maxsplit=1)[0]
    return "\n".join((head, *rows, "<!-- end -->", ""))


def test_the_page_says_what_the_file_says():
    assert PAGE.read_text(encoding="utf-8") == page()
