"""As shipped and tuned: the best is the cheapest run within the target, else the most accurate one."""

import json
import math
import re
import sys

import pytest

from mbsbench.harness.results.environment import ROOT
from mbsbench.reports import site
from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages.judged.engines import SHIPPED, TUNED, list_contests
from mbsbench.tests.factories import make_measured_record

from .conftest import put

sys.path.append(str(ROOT / "docs"))
import list_engines


def test_the_best_is_the_cheapest_within_the_target(tmp_path):
    """One contestant reaches 1e-3 twice, one never, one is refused as shipped and counts in neither sum."""
    for k, (solver, label, error, cpu) in enumerate(
        (
            ("alpha", SHIPPED, 0.1, 1.0),
            ("alpha", TUNED, 1e-5, 4.0),
            ("alpha", TUNED, 5e-4, 2.0),
            ("beta", SHIPPED, 0.2, 1.0),
            ("beta", TUNED, 0.05, 9.0),
        )
    ):
        put(
            tmp_path,
            make_measured_record(
                f"run{k}", solver, label=label, dt_s=0.1 / 2**k, position_error_max_m=error, cpu_median_s=cpu
            ),
        )
    put(tmp_path, make_measured_record("no", "gamma", "refused", label=SHIPPED, position_error_max_m=math.nan))
    (contest,) = list_contests(read_results(tmp_path))
    best = {pair.who: pair.best.record.cpu_median_s for pair in contest.pairs}
    assert (best["alpha"], best["beta"]) == (2.0, 9.0)
    assert contest.count_within([p.shipped for p in contest.pairs]) == (0, 2)
    assert contest.count_within([p.best for p in contest.pairs]) == (1, 2)
    page = (site.build_report(tmp_path).parent / "engines.html").read_text()
    assert [pair.tried for pair in contest.pairs if pair.who == "alpha"] == [2]
    assert "0 to 2 settings of each, steps of 0.00625 to 0.05 s" in " ".join(page.split())
    assert "As shipped, 0 of 2 come within 0.001 m or rad; tuned, 1 of 2" in page


def test_a_page_of_runs_as_shipped_alone_is_written(tmp_path):
    """A suite that is still running has made those first."""
    put(tmp_path, make_measured_record("run", "alpha", label=SHIPPED, dt_s=0.1, position_error_max_m=0.1))
    assert "nothing has been tuned yet" in (site.build_report(tmp_path).parent / "engines.html").read_text()


@pytest.mark.published
def test_the_tables_of_the_page_on_engines_are_what_is_published():
    """Made by docs/list_engines.py, which publishes nothing of a changed checkout."""
    page = list_engines.PAGE.read_text(encoding="utf-8")
    assert list_engines.TABLES.findall(page) == [list_engines.format_contests()], "python docs/list_engines.py"
    assert list_engines.FRONTIER.findall(page) == [list_engines.format_frontier()], "python docs/list_engines.py"


def test_the_frontier_is_published_with_losses_first(tmp_path, monkeypatch):
    """error = 0.1 dt and CPU = c/dt: 1e-3 costs 100 c, an engine's 50 on one of two; its bound is 1e-4 here."""
    monkeypatch.setattr(list_engines, "COSTS", tmp_path / "frontier.json")
    for problem, solver, c in (
        ("arm", "alpha", 1.0),
        ("arm", "mujoco", 8.0),
        ("arm", "beta", 2.0),
        ("bar", "alpha", 1.0),
        ("bar", "mujoco", 0.5),
    ):
        for k in range(8):
            dt = 0.1**k
            put(
                tmp_path / "results",
                make_measured_record(
                    f"{problem}{solver}{k}",
                    solver,
                    problem=problem,
                    dt_s=dt,
                    commit="a",
                    position_error_max_m=0.1 * dt,
                    reference_own_error_m=1e-4,
                    cpu_min_s=c / dt,
                    cpu_median_s=c / dt,
                    cpu_max_s=1.5 * c / dt,
                ),
            )
    (tmp_path / "results" / "environment.json").write_text('{"commit": "a", "cpu": "none"}')
    list_engines.publish(tmp_path / "results")
    rows = [line for line in list_engines.format_frontier().splitlines() if line.startswith(("| arm", "| bar"))]
    assert rows == [
        "| bar | **`mujoco`** 50 s, 1.5; 2, 1 | **`mujoco`** 5e+04 s, 1.5; 2, 1 † | – | – |",
        "| arm | `alpha` 1e+02 s, 1.5; 2, 8 | `alpha` 1e+05 s, 1.5; 2, 8 † | – | – |",
    ]


def test_each_cell_of_the_frontier_is_decided_or_says_why():
    """The mark stands where the spread exceeds the lead, and nowhere without its word."""
    row = {"engine": None, "cheapest": "alpha", "cpu_s": 1e-3, "below_reference": False}
    for spread, lead, ending in (
        (1.5, 1.3, " ≈ spread"),
        (1.2, 1.05, " ≈ tie"),
        (1.3, 1.3, ", –"),
        (1.0, 1.05, " ≈ tie"),
        (1.0, 1.3, ", –"),
    ):
        assert list_engines._format_frontier_cell(row | {"spread": spread, "next": lead}).endswith(ending)


def test_the_cheapest_of_a_tie_is_not_decided(tmp_path, monkeypatch):
    """On one problem the next takes a twentieth longer, on the other twice as long."""

    def contest(problem: str, factor: float) -> dict:
        cost = {"alpha": 1e-3, "beta": factor * 1e-3}
        pairs = {
            who: {"shipped": None, "best": {"error": 1e-4, "cpu_s": cpu, "status": "success"}}
            for who, cpu in cost.items()
        }
        return {"problem": problem, "unit": "m", "pairs": pairs}

    found = {"target": 1e-3, "commit": "a" * 40, "runs": 4, "budget": "2 settings of each"}
    found["contests"] = [contest("arm", 1.05), contest("bar", 2.0)]
    (tmp_path / "contests.json").write_text(json.dumps(found))
    monkeypatch.setattr(list_engines, "PUBLISHED", tmp_path / "contests.json")
    rows = [
        line.split("|")[2] for line in list_engines.format_contests().splitlines() if re.match(r"\| (arm|bar) ", line)
    ]
    assert [row.endswith(" ≈ ") for row in rows] == [True, False]


def test_the_page_on_engines_lists_what_their_adapters_take():
    """Made by docs/list_engines.py from what they declare."""
    page = list_engines.PAGE.read_text(encoding="utf-8")
    assert list_engines.ELEMENTS.findall(page) == [list_engines.format_elements()]


def test_nothing_is_published_of_a_changed_checkout(tmp_path, monkeypatch):
    """Nor of runs made at two commits."""
    monkeypatch.setattr(list_engines, "PUBLISHED", tmp_path / "contests.json")
    for commit, label in (("a", SHIPPED), ("b", TUNED)):
        put(
            tmp_path / "results",
            make_measured_record(commit, "alpha", label=label, position_error_max_m=0.1, commit=commit),
        )
    with pytest.raises(SystemExit, match="is not of one commit without changes"):
        list_engines.publish(tmp_path / "results")
    assert not list_engines.PUBLISHED.exists()
