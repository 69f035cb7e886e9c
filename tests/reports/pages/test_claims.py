"""Claims: counted, measured against their bands, mapped, and compared with what is published."""

import math
import re

from msgspec.structs import replace

from mbsbench.harness.results.judgements.claims import (
    ClaimFinding,
    ClaimGap,
    ClaimVerdict,
    Condition,
    Decision,
    MissingReason,
)
from mbsbench.reports.model import claim_groups
from mbsbench.reports.model.claim_words import (
    describe_count,
    describe_decision,
    describe_missing,
    describe_origin,
    describe_verdict,
    explain_verdicts,
    format_band,
    format_measured,
    format_verdict,
    list_rows,
)
from mbsbench.reports.pages.judged.claims import VERDICTS, count_verdicts, list_differences, make_grids, select_claims
from mbsbench.reports.pages.svg import choose_scale, describe_number_line, draw_number_line

from . import synthetic

NONE = {}


def rows():
    return synthetic.claims(["aa01", "aa02"])


def test_a_claim_without_its_runs_has_the_published_verdict_and_says_so():
    """A bench runs a part of the maps: what it cannot judge is neither blank nor passed off as its own."""
    lacking = [
        replace(
            c,
            beyond=ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD),
            missing=(MissingReason(ClaimGap.RUNS, found=2, wanted=9),),
        )
        for c in rows()
    ]
    found = select_claims([lacking[0], *rows()[1:]], NONE, rows())
    assert [c.of.id for c in found if c.published] == ["first-claim", "fourth-claim"]  # the last lacks its runs anyway
    assert [c.of.verdict for c in found] == [c.of.verdict for c in select_claims(rows(), NONE)]
    assert not any(
        c.published for c in select_claims(lacking, NONE)
    )  # nothing is published: it cannot be told, and why


def test_counts_are_those_of_the_file_and_name_absent_verdicts():
    found = count_verdicts(select_claims(rows(), NONE))
    assert {m.word: n for m, n in found} == {
        "not reproduced": 2,
        "reproduced if": 1,
        "reproduced": 2,
        "cannot be told": 1,
    }
    assert {m.word: n for m, n in count_verdicts([])}["not reproduced"] == 0


def test_checks_of_the_set_up_are_no_results():
    """They are on the page, but not in the tally of what was found about solvers."""
    found = select_claims(rows(), NONE)
    assert [c.of.id for c in found if c.presentation] == ["presentation-claim"] and len(found) == len(rows())
    assert sum(n for _, n in count_verdicts(found)) == len(rows()) - 1


def test_settings_left_open_are_not_counted_as_failing():
    third = replace(rows()[3], paper=None)
    at = [m.holds for m in third.map]
    assert at.count(None) > 0
    settles = third.beyond.settings
    assert describe_count(third) == f"holds in {at.count(True) - 1} of {settles} settings, {at.count(None)} left out"


def test_verdicts_have_a_symbol_and_a_word_each():
    marks = [VERDICTS[v] for v in ClaimVerdict]
    assert len({m.symbol for m in marks}) == len({m.word for m in marks}) == 4


def test_a_band_may_be_open_at_one_end():
    assert format_band(synthetic.TEST) == "0 to 0.05 m"
    assert format_band(replace(synthetic.TEST, band=(None, 0.05))) == "at most 0.05 m"
    assert format_band(replace(synthetic.TEST, band=(1.0, None), unit="")) == "at least 1"
    assert describe_number_line(0.02, -math.inf, 0.05, "m") == "measured 0.0200 m; band at most 0.0500 m"


def test_a_number_that_does_not_exist_is_said_so():
    none = replace(synthetic.TEST, measured=math.nan)
    assert format_measured(none) == "not measured"
    assert format_measured(replace(none, unbounded=True)) == "unbounded"
    assert format_measured(replace(none, unbounded=True, unit="s")) == "never"
    assert format_measured(replace(none, measured=12.0, unit="")) == "12"


def test_conditions_are_worded_with_counts():
    """One dimension that separates, two that do, and a mixed map."""
    words = describe_decision(Decision({"chart": ("euler313",)}))
    assert words == "it holds with chart euler313 always, and never without"
    words = describe_decision(Decision({"gain": (0.0, 5.0), "lambda_in_error_test": (True,)}, unless=True))
    assert words == "it holds with gain 0 or gain 5 and multipliers in the error test never, and always without"
    mixed = explain_verdicts(rows()[3])
    assert "always with gain 0 (6 of 6)" in mixed.lower() and "gain matters most: gain 0 6 of 6" in mixed
    assert "settings are left out beyond them: the limit on steps ended them" in mixed
    assert "At the paper's settings it holds for none of 1 tried. Beyond them it holds for" in mixed
    assert (
        "distinct of" in mixed and "Borderline: with a band 1.5 times wider (largest [series x]) it holds for" in mixed
    )


def test_what_is_missing_is_named():
    assert describe_missing(rows()[4]) == "the commercial code; runs missing: 3 of 5 of the map m, first case 3"


def diamond(svg) -> float:
    return float(re.search(r'class="dot[^"]*" d="M([\d.]+)', svg)[1])


def band_of(svg) -> tuple[float, float]:
    x, width = re.search(r'class="band" x="([\d.]+)" y="[\d.]+" width="([\d.]+)"', svg).groups()
    return float(x), float(x) + float(width)


def test_measured_mark_lies_in_the_band_exactly_when_the_number_does():
    """Also for numbers decades apart, at zero, below zero, and with an open end."""
    for low, high in ((0.0, 0.05), (-2.0, -1.0), (1e-9, 1e-3), (-math.inf, 0.3), (0.3, math.inf)):
        for value in (-1.5, 0.0, 1e-10, 0.04, 0.2, 4.0, 1e5):
            left, right = band_of(draw_number_line(value, low, high, "m", "good"))
            x = diamond(draw_number_line(value, low, high, "m", "good"))
            assert (left - 0.2 <= x <= right + 0.2) == (low <= value <= high), (value, low, high)


def test_scales_keep_the_order_of_values():
    values = [0.0, 1e-12, 3e-5, 1.0, 7e4]
    scale = choose_scale(values, 0.0, 100.0)
    assert scale.log
    places = [scale(v) for v in values]
    assert places == sorted(places)


def test_map_has_a_place_for_every_setting_and_facets_only_for_what_varies():
    at = rows()[3].map
    found = make_grids(at, NONE)
    assert len(found) == 4  # two charts, two starts
    assert all(g["tolerances"] == ("0.001", "1e-05", "1e-07") and g["gains"] == ("0", "5", "20", "1/h") for g in found)
    assert sum(len(boxes) for g in found for row in g["rows"] for boxes in row) == len(at)
    assert {g["title"] for g in found} >= {
        "chart euler313, a consistent start",
        "chart quaternion, a start from lambda = 0",
    }
    symbols = [b["mark"].symbol for g in found for row in g["rows"] for boxes in row for b in boxes]
    assert symbols.count("✓") == sum(m.holds is True for m in at)


def test_runs_that_share_a_place_are_all_there():
    found = make_grids([synthetic.ROW, replace(synthetic.ROW, holds=False)], NONE)
    assert [b["mark"].symbol for b in found[0]["rows"][0][0]] == ["✓", "✗"]


def test_changed_verdicts_against_the_published_are_found_and_put_first():
    now = rows()
    good = ClaimFinding(ClaimVerdict.REPRODUCED)
    then = [replace(c, beyond=good) for c in now if c.id not in ("fourth-claim", "conditional-claim")]
    then.append(replace(synthetic.CLAIM, id="gone", beyond=ClaimFinding(ClaimVerdict.NOT_REPRODUCED)))
    found = list_differences(now, then, select_claims(now, NONE))
    assert [d["id"] for d in found] == ["second-claim", "third-claim", "gone", "conditional-claim", "fourth-claim"]
    assert found[0]["before"].word == "reproduced" and found[0]["after"].word == "not reproduced"
    assert list_differences(now, now, select_claims(now, NONE)) == []


def test_a_place_that_many_runs_share_is_one_box_with_their_count():
    many = [replace(synthetic.ROW, holds=k < 3, case=f"case {k}") for k in range(8)]
    (box,) = make_grids(many, NONE)[0]["rows"][0][0]
    assert (box["mark"].symbol, box["mark"].kind) == ("3/8", "failed")
    assert box["words"].startswith("3 of 8 runs hold, 0 do not and stopped; first case 0")


def test_rows_are_listed_with_number_finding_and_command():
    """Printed ones first, then those that hold; a row without a command has its case."""
    own = rows()[3]
    listed = list_rows(own)
    assert len(listed) == len(own.map) and len(list_rows(own, 2)) == 2
    assert [x.startswith("printed") for x in listed] == sorted((m.printed for m in own.map), reverse=True)
    row = replace(own.map[0], command="mbsbench solve x", control=0.5, printed=True, holds=True, measured=0.25)
    (words,) = list_rows(replace(own, map=(row,)))
    assert words.startswith("printed, holds: 0.250 m, control 0.500") and words.endswith(": mbsbench solve x")


def test_groups_are_those_of_abstract_then_the_fields_then_the_papers_others_then_checks():
    """In this order on the page and in the terminal; the field's in the order of its file."""
    own = [*rows(), *synthetic.field(["aa01"])]
    found = claim_groups.group_claims(reversed(own))
    assert list(found) == list(claim_groups.GROUPS)
    assert [[c.id for c in g] for g in found.values()][:2] == [
        ["second-claim"],
        [c.id for c in reversed(synthetic.field([""]))],
    ]
    assert [c.id for c in found[claim_groups.CHECKS]] == ["presentation-claim"]
    assert [c.id for c in claim_groups.order_claims(own)] == [
        c.id for g in claim_groups.group_claims(own).values() for c in g
    ]


def test_the_number_shown_is_that_of_its_row_and_of_its_command():
    """A printed row before others; which one it is, the verdict says: against it, nearest, or the best."""
    second = rows()[1]
    assert claim_groups.find_command(second) == "mbsbench solve pendulum alpha"
    assert (
        claim_groups.describe_shown(second) == "3.00 m (asked: at most 0.05 m), of the setting that comes nearest to it"
    )
    test = replace(synthetic.TEST, measured=0.02)
    good, bad = (replace(synthetic.ROW, measured=x, holds=h) for x, h in ((0.02, True), (0.5, False)))
    twice = replace(synthetic.CLAIM, tests=(test,), map=(good, replace(good, measured=0.01)))
    assert claim_groups.name_shown_setting(twice) == "the setting that speaks most against it"
    assert claim_groups.name_shown_setting(replace(twice, map=(good, bad))) == "the setting that meets it best"
    printed = replace(good, printed=True, more=2)
    one = replace(twice, map=(bad, printed), because=replace(twice.because, across="step"))
    assert claim_groups.name_shown_setting(one) == "the one printed setting that counts, from 3 runs along step"
    assert (
        claim_groups.find_shown_row(replace(twice, tests=()))
        is None
        is claim_groups.find_shown_row(replace(twice, map=()))
    )


def test_a_sentence_names_two_of_many_combinations_and_their_rest():
    """All are named where the claim is explained."""
    at = tuple(Condition({"problem": p, "gain": float(k)}, 1, 1) for k, p in enumerate("abc"))
    finding = ClaimFinding(ClaimVerdict.REPRODUCED_IF, 7, 9, 9, decision=Decision({}, any_of=at, rest=4))
    c = replace(synthetic.CLAIM, beyond=finding)
    assert describe_verdict(c) == (
        "Beyond them reproduced if a and gain 0, or if b and gain 1, and in other settings, for 7 of 9 tried."
    )
    assert format_verdict(finding) == (
        "reproduced if a and gain 0, or if b and gain 1, or if c and gain 2, and in 4 settings more"
    )
    two = replace(finding, decision=Decision({}, any_of=at[:2]))
    assert format_verdict(two, 2) == format_verdict(two) == "reproduced if a and gain 0, or if b and gain 1"


def test_what_is_ours_is_split_from_the_statement():
    """The statement is the heading; a claim that is ours as a whole is not split."""
    says = lambda text: claim_groups.split_claim(replace(synthetic.CLAIM, claim=text))  # noqa: E731
    assert says("It grows. Ours: by a tenth.") == ("It grows.", "Ours: by a tenth.")
    assert says("Our question: does it grow?") == ("Our question: does it grow?", "")


def test_a_claim_of_the_field_has_one_verdict_and_a_source():
    """No settings are printed; its words are not quoted."""
    book, _ = synthetic.field(["aa01"])
    assert describe_verdict(book) == "Here reproduced if gain 5, for 1 of 2 tried."
    assert describe_origin(book) == "A. Author, A book (1996), Sect. 1: It grows."
    assert explain_verdicts(book).startswith("Here it holds for 1 of 2 tried")
    view = select_claims([book], NONE)[0]
    assert view.sides[0][0] == "here" and view.section == view.group == claim_groups.FIELD
