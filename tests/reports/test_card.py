"""The certificate card of a solver: each fact is the number of what it was made from, and what is unknown is absent."""

import math
import re
import xml.etree.ElementTree as ET

import pytest
from msgspec.structs import replace

from mbsbench.reports.model.followed import followed
from mbsbench.reports.model.frontier import frontiers, of_most_problems
from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages.runs.card import card_of

from .conftest import put, record
from .pages.synthetic import DRIFT, ORDER
from .test_frontier import ladder


def facts(card) -> dict[str, str]:
    return {f.name: f.value for f in card.facts}


def test_the_order_is_the_narrowest_one_at_default_options():
    wide = replace(ORDER, solver="alpha", case="alpha", quantity="position", order=3.9, low=3.5, high=4.3, declared=4.0)
    own = [wide, replace(wide, order=4.01, low=3.99, high=4.03, verdict="certified"),
           replace(wide, case="alpha[gauge=zero]", order=1.0, low=1.0, high=1.0)]  # fmt: skip
    card = card_of("alpha", own, (), (), ())
    assert facts(card)["order"].startswith("4.01 (3.99 to 4.03), declared 4") and len(card.facts) == 1


def test_the_energy_is_that_of_the_longest_run():
    long = replace(DRIFT, solver="alpha", case="pendulum alpha dt=0.1", periods=320, verdict="trend",
                   trend_W=2e-5, span_s=100.0)  # fmt: skip
    card = card_of("alpha", (), (replace(long, periods=30, verdict="bounded"), long), (), ())
    assert facts(card)["energy"] == f"drifts over 320 periods of {long.problem}, by 0.0020 J"


def test_cost_and_followed_time_are_those_of_the_runs(tmp_path):
    """Twice as dear at every error on one problem; left at 1.5 of 2 s."""
    ladder(tmp_path, "alpha", 4.0, 2e-3, accurate_until_s=1.5, accurate_until_1pct_s=1.0, accurate_until_0p1pct_s=0.5)
    ladder(tmp_path, "beta", 4.0, 1e-3)
    results = read_results(tmp_path)
    follow = [f for v in results.variants for f in followed(v)]
    card = card_of("alpha", (), (), follow, of_most_problems(frontiers(results)))
    assert facts(card)["cost"].startswith("×2.0 the cheapest at ")
    assert facts(card)["followed"] == "0 of 1 motion to the end of the reference; least pendulum, 1.5 of 2 s"


@pytest.mark.parametrize("name", ["alpha", '<script>alert("1")</script>'])
def test_the_badge_is_a_file_of_its_own(tmp_path, name):
    """An SVG that needs no page, with the values of the card, whatever the solver is called."""
    own = replace(ORDER, solver=name, case=name, quantity="position", order=2.0, low=1.9, high=2.1)
    badge = str(card_of(name, [own], (), (), ()).badge)
    assert "order 2.00" in badge and "<script>" not in badge and "var(" not in badge
    root = ET.fromstring(badge)
    assert root.tag.endswith("svg") and float(root.attrib["width"]) > 0.0
    texts = [t for t in root.iter() if t.tag.endswith("text")]
    right = max(float(t.attrib["x"]) for t in texts)
    assert right < float(root.attrib["width"]) and re.match(r"[\w<]", texts[0].text)


def test_nothing_is_said_of_what_is_not_known(tmp_path):
    put(tmp_path, record("aa01", accurate_until_s=math.nan))
    assert card_of("alpha", (), (), (), ()).facts == ()
