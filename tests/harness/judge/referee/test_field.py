"""The field's register: statements of textbooks and manuals, judged by the functions that judge the paper's claims."""

import dataclasses
import re

import pytest

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.judge.referee import judge as judging
from mbsbench.harness.judge.referee.claims.frame import list_values, read_dimensions, select_runs
from mbsbench.harness.judge.referee.claims.measures import MEASURES
from mbsbench.harness.judge.referee.claims.register import read_register
from mbsbench.harness.judge.referee.claims.settings import is_partner
from mbsbench.harness.judge.referee.currency import digest_code_and_claims
from mbsbench.harness.judge.referee.registers import FIELD, PAPER
from mbsbench.harness.results.judgements import files
from mbsbench.harness.results.judgements.claims import ClaimVerdict
from mbsbench.tests.factories import make_record
from mbsbench.tests.stale import REMEDY

REGISTER = read_register(FIELD.path)
TEXT = FIELD.path.read_text(encoding="utf-8")
NEW = """
[maps.hem4]
over = [{ problem = "heavy_top", solver = "half_explicit", step = [0.004, 0.00025] }]

[[claims]]
id = "hem4"
section = "Brasey and Hairer, SIAM J. Numer. Anal. 30 (1993), 538-552"
quote = "HEM4 is of order four."
claim = "The error at a sixteenth of the step is 16 to the power of four smaller."
map = "hem4"
across = "step"
tests = [{ metric = "loss", combine = "last over first", at_most = 6e-5, unit = "" }]
"""


@pytest.fixture(scope="module")
def tried():
    """The rows of all runs that the field's claims may be tried on."""
    return [read_dimensions(s) for s in judging.list_tried_runs(FIELD)]


def judge_alone(name, record_of, place=FIELD):
    """The verdict on one claim, from the records that ``record_of`` makes of the runs of its maps."""
    alone = dataclasses.replace(place, only=name)
    records = [record_of(s) for s in judging.select_needed_runs(alone)]
    (found,) = judging.judge_register(alone, records, lambda r: None)
    return found


def test_each_statement_has_a_source_and_says_which_bands_are_ours():
    """Ten statements, none of the paper's register; where they stand, by name and year or section."""
    own, paper = ({c.id for c in read_register(p.path).claims} for p in (FIELD, PAPER))
    assert len(own) == len(REGISTER.claims) == 10 and not own & paper
    for c in REGISTER.claims:
        assert re.search(r"\(\d{4}\)|documentation", c.section) and not c.section[0].isdigit(), c.id
        assert "Ours: " in c.claim and c.tests and not c.needs and not c.summary, c.id


@pytest.mark.beyond_core
def test_every_map_matches_runs_and_has_its_dimensions(tried):
    """A claim whose runs nobody makes would never be judged; no textbook prints settings, and one is on an engine."""
    used = {m.name for c in REGISTER.claims for m in c.maps if m}
    assert used == set(REGISTER.maps)
    for m in REGISTER.maps.values():
        assert m.dimensions and not m.printed, m.name
        for selection in m.over:
            assert select_runs(tried, [selection]), f"{m.name}: {selection}"
        found = select_runs(tried, m.over)
        for name, wanted in m.dimensions.items():
            assert len(list_values(p.dimensions.get(name) for p in found)) == wanted, f"{m.name}: {name}"


def test_groups_and_partners_are_there(tried):
    """Values along a dimension are in the map, and each compared run has its partner."""
    for c in REGISTER.claims:
        own = select_runs(tried, c.map.over)
        others = select_runs(tried, c.against.over) if c.against else ()
        assert not c.against or all(any(is_partner(c, p, q) for q in others) for p in own), c.id
        assert not c.across or len(list_values(p.dimensions.get(c.across) for p in own)) > 1, c.id


def test_a_claim_is_added_by_the_file_alone(tmp_path):
    """Its runs are those of a suite; no function learns of it. The verdict is that of the errors' order."""
    place = dataclasses.replace(FIELD, path=tmp_path / "field.toml")
    place.path.write_text(TEXT + NEW)
    assert len(place.read().claims) == len(REGISTER.claims) + 1

    def of_order(p):
        return lambda s: make_record(s, steps=round(5.0 / s.control.dt), position_error_judged_m=s.control.dt**p)

    for order, verdict in ((4.0, ClaimVerdict.REPRODUCED), (2.0, ClaimVerdict.NOT_REPRODUCED)):
        found = judge_alone("hem4", of_order(order), place)
        assert (found.verdict, found.register, found.paper) == (verdict, "field", None)


def test_a_run_of_another_order_turns_a_verdict():
    """Multipliers of order one at one of the forms: reproduced, if the other."""

    def record(s, index3):
        order = index3 if s.options.get("form") == "index3" else 2.0
        return make_record(s, steps=round(1.0 / s.control.dt), reaction_error_max_N=s.control.dt**order)

    good = judge_alone("alpha-multipliers", lambda s: record(s, 2.0))
    assert good.verdict is ClaimVerdict.REPRODUCED
    bad = judge_alone("alpha-multipliers", lambda s: record(s, 1.0))
    assert bad.verdict is ClaimVerdict.REPRODUCED_IF and bad.beyond.decision.by == {"form": ("stabilised",)}


def test_a_flipped_sign_in_a_metric_turns_a_verdict(monkeypatch):
    """Steps that lose 5 mJ do not keep the energy; with the other sign the loss would lie below every limit."""
    losing = lambda s: make_record(s, energy_drift_max_J=5e-3)  # noqa: E731
    assert judge_alone("energy-momentum-any-step", losing).verdict is ClaimVerdict.NOT_REPRODUCED
    column = MEASURES["column"]
    monkeypatch.setitem(MEASURES, "column", dataclasses.replace(column, of=_negate(column.of)))
    assert judge_alone("energy-momentum-any-step", losing).verdict is ClaimVerdict.REPRODUCED


def _negate(function):
    """The measure with the other sign, and the same arguments."""

    def negated(record, series, name, partial=False):
        return -function(record, series, name, partial)

    return negated


@pytest.mark.beyond_core
def test_a_setting_that_is_a_vector_can_be_read_back(tmp_path):
    """A map over factors of inertia, three numbers each, by which runs of an engine differ."""
    found = judge_alone("euler-free-rotation", lambda s: make_record(s, energy_start_J=1.0, energy_drift_max_J=0.5))
    place = ConfinedPath(tmp_path)
    judging.write_judgements(
        place, {FIELD.file.name: (found,)}, {FIELD.file.name: digest_code_and_claims(REGISTER, ())}
    )
    (again,) = files.read_claims(place, FIELD.file)
    assert (1.0, 2.0, 3.0) in [f.value for f in again.factors["inertia_factors"]] and again == found


@pytest.mark.published
def test_published_verdicts_are_of_this_code():
    """As those of the paper are."""
    outdated = judging.describe_outdated(files.PUBLISHED, FIELD)
    assert not outdated, f"{outdated}\n{REMEDY}"
    assert [c.id for c in files.read_claims(files.PUBLISHED, FIELD.file)] == [c.id for c in REGISTER.claims]
