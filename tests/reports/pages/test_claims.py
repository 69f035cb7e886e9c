"""Claims: counted, measured against their bands, mapped, and compared with what is published."""

import math
import re

from mbsbench.reports.pages.claim_map import grids
from mbsbench.reports.pages.claims import band_of, claims_of, counts, differences, verdict
from mbsbench.reports.pages.judgement import Entry
from mbsbench.reports.pages.links import links_of
from mbsbench.reports.pages.svg import number_line, said, scale_for

from . import synthetic

NONE = links_of([])


def rows():
    return [Entry(row) for row in synthetic.claims(["aa01", "aa02"])]


def test_counts_are_those_of_the_file_and_name_absent_verdicts():
    found = counts(claims_of(rows(), NONE))
    assert {m.word: n for m, n in found} == {"refuted": 1, "conditional": 1, "supported": 2, "untestable": 1}
    assert {m.word: n for m, n in counts([])}["refuted"] == 0


def test_checks_of_the_variant_are_no_results():
    """They are on the page, but not in the tally of what was found about solvers."""
    found = claims_of(rows(), NONE)
    assert [c.id for c in found if c.presentation] == ["posed-claim"] and len(found) == len(rows())
    assert sum(n for _, n in counts(found)) == len(rows()) - 1


def test_settings_left_open_are_not_counted_as_failing():
    (third,) = [c for c in claims_of(rows(), NONE) if c.id == "third-claim"]
    at = [e.flag("holds") for e in rows()[2].entries("map")]
    assert at.count(None) > 0
    assert third.tried == f"{at.count(True)} of {len(at) - at.count(None)} settings hold, {at.count(None)} left out"


def test_verdict_has_symbol_and_word_and_an_unknown_one_is_no_success():
    symbols = {verdict(v).symbol for v in ("SUPPORTED", "REFUTED", "CONDITIONAL", "UNTESTABLE")}
    assert len(symbols) == 4
    assert verdict("PERHAPS").kind == "failed" and verdict("PERHAPS").word == "perhaps"


def test_band_may_be_open_at_one_end_or_no_numbers():
    assert band_of(Entry({"band": [None, 0.05]})) == (-math.inf, 0.05)
    assert band_of(Entry({"band": {"low": 1.0}})) == (1.0, math.inf)
    assert band_of(Entry({"band": "as printed"})) is None
    assert band_of(Entry({"band": [None, None]})) is None
    assert said(0.02, -math.inf, 0.05, "m") == "measured 0.0200 m; band at most 0.0500 m"


def diamond(svg) -> float:
    return float(re.search(r'class="dot[^"]*" d="M([\d.]+)', svg)[1])


def band(svg) -> tuple[float, float]:
    x, width = re.search(r'class="band" x="([\d.]+)" y="[\d.]+" width="([\d.]+)"', svg).groups()
    return float(x), float(x) + float(width)


def test_measured_mark_lies_in_the_band_exactly_when_the_number_does():
    """Also for numbers decades apart, at zero, below zero, and with an open end."""
    for low, high in ((0.0, 0.05), (-2.0, -1.0), (1e-9, 1e-3), (-math.inf, 0.3), (0.3, math.inf)):
        for value in (-1.5, 0.0, 1e-10, 0.04, 0.2, 4.0, 1e5):
            left, right = band(number_line(value, low, high, "m", "good"))
            x = diamond(number_line(value, low, high, "m", "good"))
            assert (left - 0.2 <= x <= right + 0.2) == (low <= value <= high), (value, low, high)


def test_scales_keep_the_order_of_values():
    values = [0.0, 1e-12, 3e-5, 1.0, 7e4]
    scale = scale_for(values, 0.0, 100.0)
    assert scale.log
    places = [scale(v) for v in values]
    assert places == sorted(places)


def test_map_has_a_place_for_every_setting_and_facets_only_for_what_varies():
    at = [Entry(row) for row in synthetic.claims(["aa01"])[2]["map"]]
    found = grids(at, NONE)
    assert len(found) == 4  # two charts, two starts
    assert all(g.tolerances == ("0.001", "1e-05", "1e-07") and g.gains == ("0", "5", "20", "1/h") for g in found)
    assert sum(len(boxes) for g in found for row in g.rows for boxes in row) == len(at)
    assert {g.title for g in found} >= {"euler313, consistent start", "quaternion, start not made consistent"}
    symbols = [b.mark.symbol for g in found for row in g.rows for boxes in row for b in boxes]
    assert symbols.count("✓") == sum(e.flag("holds") is True for e in at)


def test_runs_that_share_a_place_are_all_there():
    same = {"tolerance": 1e-3, "gain": 5.0, "holds": True}
    found = grids([Entry(same | {"frame": "yawed"}), Entry(same | {"frame": "yawed", "holds": False})], NONE)
    assert [b.mark.symbol for b in found[0].rows[0][0]] == ["✓", "✗"]


def test_changed_verdicts_against_the_published_are_found_and_put_first():
    now = rows()
    then = [Entry({**e.given, "verdict": "SUPPORTED"}) for e in now if e.text("id") != "fourth-claim"]
    then.append(Entry({"id": "gone", "verdict": "REFUTED"}))
    found = differences(now, then, claims_of(now, NONE))
    assert [d.id for d in found] == ["second-claim", "third-claim", "gone", "fourth-claim"]
    assert found[0].before.word == "supported" and found[0].after.word == "refuted"
    assert differences(now, now, claims_of(now, NONE)) == []


def test_a_place_that_many_runs_share_is_one_box_with_their_count():
    many = [Entry({"tolerance": 1e-3, "gain": 5.0, "holds": k < 3, "case": f"case {k}"}) for k in range(8)]
    (box,) = grids(many, NONE)[0].rows[0][0]
    assert (box.mark.symbol, box.mark.kind) == ("3/8", "failed")
    assert box.words.startswith("3 of 8 runs hold, 0 do not and stopped; first case 0")
