"""The rules of counting: two verdicts a claim, bands that are moved, early ends, and equal series."""

import math

import numpy as np
import pytest

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.judge.referee.claims.bands import Band
from mbsbench.harness.results.judgements.claims import ClaimGap, CodeDigests, Ending, ExcludedSettings
from mbsbench.harness.results.judgements.files import CLAIMS, add_code, format_judgement, read_judgement, shorten_claims
from mbsbench.reports.model.claim_words import (
    explain_verdicts,
    format_distinct,
    format_separation,
    format_share,
    format_verdict,
    list_rows,
)
from mbsbench.tests.factories import make_record, make_series

from .claiming import RUNS, TEST, claim, options

PRINTED = TEST.replace('"m"', '"p"')


def sizes(of):
    """Records with the |phi| that ``of`` gives for chart, tolerance and lambda in the test."""
    return [make_record(x, phi_max=of(x)) for x in RUNS if x.solver == "ida_index1"]


def is_printed(x):
    return options(x)["chart"] == "euler313" and x.control.rtol == 1e-3


def test_printed_settings_have_a_verdict_of_their_own():
    """Good where the paper says, bad elsewhere, and the other way round; without printed rows there is one verdict."""
    c = claim(PRINTED, sizes(lambda x: 0.1 if is_printed(x) else 9.0))
    assert (c.paper.verdict, c.paper.holds, c.paper.settings) == ("reproduced", 2, 2)
    assert (c.beyond.verdict, c.beyond.holds, c.beyond.settings) == ("not reproduced", 0, 10)
    assert c.verdict == "reproduced" and c.verdicts == "reproduced, beyond not reproduced"
    c = claim(PRINTED, sizes(lambda x: 9.0 if is_printed(x) else 0.1))
    assert c.verdicts == "not reproduced, beyond reproduced"
    assert claim().paper is None and claim().verdicts == "beyond reproduced"


def test_a_condition_separates_or_values_that_suffice_are_named():
    """Values of one dimension, of two, their complement; else some with which the claim always holds."""
    c = claim(records=sizes(lambda x: 0.1 if x.control.rtol <= 1e-4 else 9.0))
    assert c.verdict == "reproduced if" and format_separation(c.beyond.decision) == "tolerance at most 0.0001"
    c = claim(records=sizes(lambda x: 9.0 if options(x) == {"chart": "euler313", "lam": True} else 0.1))
    assert c.verdict == "reproduced if" and c.beyond.decision.unless
    assert "It holds with multipliers in the error test and chart euler313 never" in explain_verdicts(c)
    c = claim(records=sizes(lambda x: 0.1 if (options(x)["chart"] == "euler313") == (x.control.rtol > 5e-4) else 9.0))
    assert c.verdict == "reproduced if" and "for 6 of 12 tried" in explain_verdicts(c) and not c.beyond.decision.by
    enough = "chart quaternion and tolerance 1e-06 or 0.0001", "chart euler313 and tolerance 0.001"
    assert all(words in format_verdict(c.beyond) for words in enough) and format_verdict(c.beyond).startswith(
        "reproduced if chart"
    )
    assert c.beyond.decision.rest == 0 and sum(x.settings for x in c.beyond.decision.any_of) == 6


@pytest.mark.parametrize(
    ("size", "flips"),
    [
        (1.4, [("wider", "reproduced", 12)]),
        (1.6, []),
        (0.7, [("narrower", "not reproduced", 0)]),
        (0.6, []),
    ],
)
def test_a_verdict_that_hangs_on_its_band_is_borderline(size, flips):
    """Of at most 1 m, half as much again or two thirds of it are taken for the band, and both outcomes said."""
    c = claim(records=sizes(lambda x: size))
    assert [(m.by, m.verdict, m.holds) for m in c.beyond.borderline] == flips
    assert ("borderline" in format_share(c.beyond)) is bool(flips)


def test_counts_and_ends_have_no_wider_band():
    """One step is no step and a half, the end of the time is not two thirds of it."""
    steps = 'map = "m"\ntests = [{ metric = "column", name = "steps", at_most = 1, unit = "" }]\n'
    assert claim(steps, [make_record(x, steps=1) for x in RUNS]).beyond.borderline == ()
    reached = 'map = "m"\ntests = [{ metric = "reached", at_least = 1, unit = "" }]\n'
    assert claim(reached).beyond.borderline == ()


@pytest.mark.parametrize(
    ("limit", "natural", "wider"),
    [
        (2.0, {}, 3.0),
        (2.0, {"is_ratio": True}, 2.5),
        (1.0, {"is_ratio": True}, 1.0),
        (0.5, {"is_ratio": True}, 0.6),
        (290.0, {"end": 300.0}, 293.3333),
        (10.0, {"end": 40.0}, 15.0),
    ],
)
def test_a_band_moves_from_its_natural_limit(limit, natural, wider):
    """Equality of a ratio and the end of the time do not move; a ratio and its inverse move alike."""
    high = Band(-math.inf, limit).move(1.5, **natural).high
    assert high == pytest.approx(wider, rel=1e-6)
    assert Band(-math.inf, high).move(1.0 / 1.5, **natural).high == pytest.approx(limit)
    if "is_ratio" in natural:
        assert Band(1.0 / limit, math.inf).move(1.5, **natural).low == pytest.approx(1.0 / wider)
    else:
        assert Band(limit, math.inf).move(1.0 / 1.5, **natural).low == pytest.approx(wider, rel=1e-6)


def test_a_limit_next_to_a_natural_one_is_not_borderline():
    """Constant steps have the ratio 1; a run of 10 s that stops at 9.9 s does not stop before 9 s, nor before 9.3 s."""
    ratio = 'map = "m"\ntests = [{ metric = "step ratio", at_most = 1.000001, unit = "" }]\n'
    c = claim(ratio, of=lambda r: make_series(np.linspace(0.0, 10.0, 101)))
    assert c.verdict == "reproduced" and c.beyond.borderline == ()
    early = 'map = "m"\ntests = [{ metric = "stops at", at_most = 9, unit = "s" }]\n'
    for stops, marked in ((9.9, False), (9.2, True)):
        c = claim(early, [make_record(x, status="singular", t_reached_s=stops, steps=9) for x in RUNS])
        assert c.verdict == "not reproduced" and bool(c.beyond.borderline) is marked


PARTIAL = TEST.replace('"phi_max"', '"phi_max", partial = true')
FAILED = {"status": "diverged", "t_reached_s": 3.0, "steps": 9, "phi_max": 9.0}


def test_a_verdict_that_hangs_on_one_failed_run_is_none():
    """Eleven of twelve hold. Where a run fails is decided by rounding: one that failed decides nothing, two do."""

    def with_failed(*numbers):
        return claim(
            PARTIAL, [make_record(x, **(FAILED if k in numbers else {"phi_max": 0.5})) for k, x in enumerate(RUNS)]
        )

    c = with_failed(3)
    assert c.verdict == "cannot be told" and (c.beyond.holds, c.beyond.settings) == (11, 12)
    (doubt,) = c.beyond.missing
    assert doubt.gap is ClaimGap.HANGS and doubt.name == c.map[3].case and doubt.name in explain_verdicts(c)
    assert with_failed(3, 4).verdict == "reproduced if"
    ended = [make_record(x, phi_max=9.0 if k == 3 else 0.5) for k, x in enumerate(RUNS)]
    assert claim(PARTIAL, ended).verdict in ("reproduced if",)


def test_of_many_values_one_that_meets_it_must_not_be_a_failed_run():
    """A claim met at one of three tolerances says so; if that run failed, there is no verdict."""
    text = PARTIAL.replace("at_most = 1.0", 'combine = "nearest", at_least = 5.0') + 'across = "tolerance"\n'

    def met(**columns):
        def big(x):
            return x.control.rtol == 1e-4 and options(x) == {"chart": "euler313", "lam": True}

        return claim(text, [make_record(x, **(columns if big(x) else {"phi_max": 0.5})) for x in RUNS])

    c = met(phi_max=9.0)
    assert c.verdict == "reproduced if" and c.beyond.met == (1, 3)
    assert format_share(
        c.beyond
    ) == "for 1 of 4 tried, at 1 of 3 values" and "met at 1 of 3 tolerances" in explain_verdicts(c)
    c = met(**FAILED)
    assert c.verdict == "cannot be told" and [m.gap for m in c.beyond.missing] == [ClaimGap.HANGS]


def test_few_that_got_to_the_moment_settle_nothing():
    """One of twelve settings is less than a tenth, two are more; how many there were is said."""
    ended = {"status": "diverged", "t_reached_s": 3.0, "steps": 9}

    def reached(n):
        return claim(records=[make_record(x, phi_max=0.5, **({} if k < n else ended)) for k, x in enumerate(RUNS)])

    c = reached(1)
    assert c.verdict == "cannot be told" and "1 of 12 settings got to the moment" in explain_verdicts(c)
    assert reached(2).verdict == "reproduced"


def test_an_identity_counts_once():
    """The number of bodies is the problem's, whatever the solver: twelve settings are one, and no other is printed."""
    c = claim('map = "m"\ntests = [{ metric = "number", of = "bodies", at_least = 1, at_most = 1, unit = "" }]\n')
    assert (c.verdict, c.paper.holds, c.paper.settings, c.paper.rows) == ("reproduced", 1, 1, 12)


def test_a_run_that_ended_before_the_moment_asked_about_is_open():
    """Diverged at 3 s, it says nothing on 4 s and something on 2 s; where reaching the end is asked too, it fails."""
    ended = {"status": "diverged", "t_reached_s": 3.0, "steps": 9}

    def of(r):
        t = np.linspace(0.0, r.t_reached_s, 31)
        return make_series(t, x=0.1 * t)

    def first(tests):
        text = f'map = "m"\ntests = [{tests}]\n'
        return claim(text, [make_record(x, **(ended if k == 0 else {})) for k, x in enumerate(RUNS)], of)

    for at, holds in ((4.0, None), (2.0, True)):
        for test in (f'metric = "value", series = "x", at = {at}', f'metric = "largest", series = "x", to = {at}'):
            c = first(f'{{ {test}, at_most = 1, unit = "m" }}')
            assert c.map[0].holds is holds and c.verdict == "reproduced"
            assert c.beyond.left_out == (() if holds else (ExcludedSettings(Ending.EARLY, 1),))
    c = first('{ metric = "largest", series = "x", at_most = 2, unit = "m" }')
    assert c.map[0].holds is None
    reaching = '{ metric = "reached", at_least = 1, unit = "" }'
    c = first(f'{{ metric = "largest", series = "x", at_most = 2, unit = "m" }}, {reaching}')
    assert c.map[0].holds is False and (c.beyond.holds, c.beyond.settings) == (11, 12)


def test_rows_with_equal_series_count_once():
    """Multipliers in the error test change nothing: of twelve runs six are distinct, and a verdict counts six."""

    def made(x, holds):
        motion = f"{options(x)['chart']} {x.control.rtol}"
        return make_record(x, phi_max=0.1 if holds(x) else 9.0, series_sha256=motion)

    c = claim(records=[made(x, lambda x: True) for x in RUNS])
    assert (c.beyond.holds, c.beyond.settings, c.beyond.rows) == (6, 6, 12) and format_distinct(
        c.beyond
    ) == "6 distinct of 12"
    assert [m.twin for m in c.map].count(True) == 6 and "(6 distinct of 12)" in explain_verdicts(c)
    c = claim(records=[made(x, lambda x: options(x)["chart"] == "euler313") for x in RUNS])
    assert (c.beyond.holds, c.beyond.settings) == (3, 6) and c.beyond.decision.by == {"chart": ("euler313",)}
    c = claim(PRINTED, [made(x, lambda x: True) for x in RUNS])
    assert (c.paper.settings, c.paper.rows, c.beyond.settings, c.beyond.rows) == (1, 2, 5, 10)


def test_equal_series_of_which_the_others_differ_are_two():
    """A comparison is of two runs: the same motion beside two others is two settings."""
    text = (
        'map = "m"\nagainst = "m"\npair_by = ["chart", "tolerance"]\ntests = [{ metric = "column", '
        'name = "phi_max", compare = "over largest", at_most = 2, unit = "" }]\n'
    )
    found = [
        make_record(x, phi_max=1.0, series_sha256="same" if options(x)["lam"] else str(k)) for k, x in enumerate(RUNS)
    ]
    assert claim(text, found).beyond.settings == 12


def test_every_row_is_published_with_its_number_and_command(tmp_path):
    """Number, holds or not, printed or not; the command of a run stands once in the file, and is back in each row."""
    own = [c for c in RUNS if c.solver == "ida_index1"]
    c = claim(PRINTED, [make_record(x, phi_max=1.9 if x is own[0] else 0.1) for x in RUNS])
    (kept,) = shorten_claims([c])
    assert [(m.holds, m.measured, m.printed) for m in kept.map] == [(m.holds, m.measured, m.printed) for m in c.map]
    assert len(kept.map) == 12 and not kept.settings_ids and kept.map[0].command.startswith("mbsbench solve")
    assert kept.verdicts == c.verdicts and explain_verdicts(kept) == explain_verdicts(c)
    (tmp_path / "claims.json").write_text(format_judgement(add_code([kept, kept], CodeDigests({}, {}, "", "", ""))))
    text = (tmp_path / "claims.json").read_text()
    assert text.count("mbsbench solve") == 12
    for found in read_judgement(CLAIMS, ConfinedPath(tmp_path)):
        assert list_rows(found) == list_rows(kept)
    assert list_rows(kept)[0].startswith(
        "printed, holds: 0.100 p, success: mbsbench solve spherical_pendulum ida_index1"
    )
