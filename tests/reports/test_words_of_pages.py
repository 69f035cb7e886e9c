"""Who is called wrong is so at a setting, on a problem, over a time, by a number; who leads is so by the data."""

import math
import re

import pytest

from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results.records import format_reasons
from mbsbench.reports import site
from mbsbench.reports.model.frontier import find_frontiers, tabulate_costs
from mbsbench.reports.model.margin import SHARE, describe_excess
from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages.judged.cost import state_cheapest
from mbsbench.reports.pages.runs.overview import list_false_successes
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import put
from .outline import Outline
from .test_frontier import HALVINGS, ladder
from .test_heat import broken, moving

LONG = '{"coordinates": "euler313", "lambda_in_error_test": true, "accelerations": "eliminated"}'


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Alpha follows the motion, beta leaves it; gamma is wrong at its coarse step alone, with many options."""
    folder = tmp_path_factory.mktemp("words")
    put(folder, make_measured_record("aa01", "alpha", accurate_until_s=2.0), moving(0))
    put(folder, make_measured_record("bb01", "beta", accurate_until_s=1.25, dt_s=0.004), moving(1))
    put(
        folder,
        make_measured_record("cc01", "gamma", dt_s=0.04, solver_options=LONG, **broken(Law.ENERGY, 0.45, 0.1, "J")),
        moving(2),
    )
    put(folder, make_measured_record("cc02", "gamma", dt_s=0.001, accurate_until_s=2.0), moving(0))
    put(
        folder,
        make_measured_record(
            "dd01", "delta", "refused", claimed="refused", message="no", position_error_max_m=math.nan
        ),
    )
    return site.build_report(folder).parent


def read(page) -> str:
    return " ".join(Outline(page.read_text(encoding="utf-8")).text.split())


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        (
            Reason(Law.ENERGY, 51.6, 9.49, "J", 0.489),
            "the energy error reaches 51.6 J, 5.4 times the 9.49 J allowed, first at 0.489 s",
        ),
        (Reason(Law.ORTHOGONALITY, 0.0163, 0.001), "|R^T R - 1| reaches 0.0163, 16 times the 0.00100 allowed"),
        (Reason(Law.CONSTRAINT, 3.2, 1.0, SHARE), "|phi| reaches 3.2 times its limit"),
        (
            Reason(
                Law.SYMMETRY, 97.0, 1.0, name="error of accelerations, beside what steps of this length leave open,"
            ),
            "error of accelerations, beside what steps of this length leave open, reaches 97.0, "
            "97 times the 1.00 allowed",
        ),
        (Reason(Law.END, 1.5, 2.0, "s"), "success claimed, but the last step ends at 1.5 s of 2 s"),
    ],
)
def test_what_breaks_a_limit_is_a_sentence_with_its_numbers(reason, words):
    """What, by how much, how often the limit, which limit, since when; what has no size says what happened."""
    assert describe_excess(reason) == words


def test_a_card_names_setting_problem_and_time_in_full(built, tmp_path):
    """However long the settings are; the headline counts runs, and accuses no code."""
    text = read(built / "index.html")
    assert "1 of 4 runs reports success and is wrong" in text
    card = text[text.index("gamma on pendulum, dt = 0.04 s, ") :].partition(".repeat it")[0]
    assert all(f"{name} = " in card for name in ("accelerations", "coordinates", "lambda_in_error_test"))
    assert "…" not in card and "..." not in card
    broken_law = "the energy error reaches 0.450 J, 4.5 times the 0.100 J allowed"
    assert f"claims success over 2 s; {broken_law}" in card
    put(tmp_path, make_measured_record("ff01", "ida_index3", **broken(Law.ENERGY, 0.45, 0.1, "J")), make_swing())
    cards, count, _ = list_false_successes(read_results(tmp_path), "recommended")
    assert count == 1 and any("SUNDIALS" in c["code"] for c in cards)
    page = site.build_report(tmp_path).read_text(encoding="utf-8")
    assert "SUNDIALS" not in re.search(r'<h2 id="wrong">(.*?)</h2>', page)[1]


def test_warnings_have_a_denominator_and_a_time(built):
    """On the pages of solvers and of a problem; what was refused did not begin."""
    for page in ("solvers.html", "solver-gamma.html"):
        text = read(built / page).replace(" ,", ",")
        of = 2 if page == "solver-gamma.html" else 4
        assert f"1 of {of} runs reports success and is wrong" in text
        assert "gamma 1 of 2 runs, such as ✗ wrong dt = 0.04 s" in text
        assert "on pendulum, over 2 s: the energy error reaches 0.45 J, more than 0.1 J" in text


def test_headings_name_the_settings_that_they_are_about(built):
    """The finest ones of each solver, or the one's that leaves the motion."""
    assert "3 of 4 solvers succeed, at the finest setting of each problem" in read(built / "solvers.html")
    assert re.search("solvers? .*stays? within every limit.*, each at its finest setting", read(built / "index.html"))
    assert "2 of 3 solvers follow the motion to 2 s; beta, dt = 0.004 s, leaves it at 1.25 s" in read(
        built / "problem-pendulum.html"
    )


def test_the_stage_calls_nobody_the_worst_or_the_cheapest(built):
    """A false success is shown as one; it is chosen to be telling, and costs are known to a tenth at best."""
    text = read(built / "index.html")
    assert "gamma a false success, dt = 0.04 s" in text and "the worst" not in text
    assert "alpha among the cheapest accurate, dt = 0.01 s" in text


def test_reasons_that_have_no_words_of_their_own_are_still_told(tmp_path):
    """A law by its name alone, without a time."""
    why = format_reasons([Reason(Law.SYMMETRY, 2.0, 1.0, "m", name="mirrored motion")])
    put(tmp_path, make_measured_record("aa01", "alpha", "wrong", wrong_because=why), make_swing())
    cards, _, _ = list_false_successes(read_results(tmp_path), "recommended")
    (card,) = [c for c in cards if not c["published"]]
    assert card["broken"] == "mirrored motion reaches 2.00 m, 2.0 times the 1.00 m allowed"


def test_a_right_motion_has_no_card(tmp_path):
    """Its rates break a law, and all that is compared agrees: the first page accuses nobody of that."""
    why = format_reasons([Reason(Law.TRUNCATION, 97.0, 1.0, name="error of accelerations")])
    right = {"motion_error_judged_m": 1e-4, "rate_error_judged_m_per_s": 1e-4, "speed_scale_m_per_s": 1.0}
    for motion, count in ((1e-4, 0), (0.02, 1)):
        columns = {**right, "motion_error_judged_m": motion, "judged_to_s": 2.0, "wrong_because": why}
        put(tmp_path, make_measured_record("aa01", "alpha", "wrong", **columns), make_swing())
        cards, wrong, _ = list_false_successes(read_results(tmp_path), "recommended")
        assert wrong == 1 and len([c for c in cards if not c["published"]]) == count


def test_solvers_that_lead_as_often_are_all_named(tmp_path):
    """The first in the alphabet is no winner."""
    for problem, (alpha, beta) in {"arm": (1e-3, 2e-3), "bar": (2e-3, 1e-3)}.items():
        ladder(tmp_path, "alpha", 4.0, alpha, problem=problem)
        ladder(tmp_path, "beta", 4.0, beta, problem=problem)
    found = [f for f in find_frontiers(read_results(tmp_path)) if f.target == 1e-3]
    assert state_cheapest(found).startswith("At 0.001 m, alpha and beta are each cheapest on 1 of 2 problems; ")


def test_who_does_not_get_there_because_it_is_wrong_is_so_at_a_setting(tmp_path):
    """How many of its runs, and the finest of them."""
    for solver in ("alpha", "beta"):
        ladder(tmp_path, solver, 4.0, 1e-3)
    ladder(tmp_path, "delta", 4.0, 1e-6, status="wrong")
    results = read_results(tmp_path)
    (race,) = tabulate_costs(results, find_frontiers(results), lambda run: "")
    finest = 0.1 / 2 ** HALVINGS[-1]
    assert race["solvers"]["delta"]["why"] == f"✗ 9 of 9 runs report success and are wrong, finest dt = {finest:g} s"
