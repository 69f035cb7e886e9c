"""Two runs: what changed is found, ranked by how much it matters, and given its possible reasons."""

import dataclasses
import json
import math

import pytest
from msgspec.structs import replace

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.results.judgements.claims import ClaimFinding, ClaimVerdict
from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages.compare import (
    Rank,
    find_unmeasured,
    format_distinguishably,
    list_changed_claims,
    list_changed_physics,
    list_changed_statuses,
    list_changed_timings,
    list_changed_work,
    list_changes,
    write_compare,
)
from mbsbench.tests.factories import make_measured_record, make_swing

from ..conftest import HOSTILE, because, every_kind, put
from ..outline import Outline, opened
from .synthetic import CLAIM


def test_what_became_wrong_comes_before_what_got_better():
    before = [
        make_measured_record("aa01"),
        make_measured_record("aa02", status="diverged"),
        make_measured_record("aa03"),
        make_measured_record("aa04", status="wrong"),
    ]
    after = [
        make_measured_record("aa01", status="wrong"),
        make_measured_record("aa02"),
        make_measured_record("aa03", status="stalled"),
        make_measured_record("aa04"),
    ]
    found = list_changed_statuses(before, after)
    assert [(r.settings_id, r.worse) for r in found] == [
        ("aa01", True),
        ("aa03", True),
        ("aa04", False),
        ("aa02", False),
    ]
    assert list_changed_statuses(before, before) == []


def test_a_large_part_of_the_scale_outranks_many_decades_of_nothing():
    """1e-15 to 1e-11 J of 1 J is five decades of nothing; 0.01 to 0.05 J is four hundredths of all there is."""
    before = [
        make_measured_record("aa01", energy_drift_max_J=1e-15),
        make_measured_record("aa02", energy_drift_max_J=0.01),
    ]
    after = [
        make_measured_record("aa01", energy_drift_max_J=1e-6),
        make_measured_record("aa02", energy_drift_max_J=0.05),
    ]
    found = list_changed_physics(before, after)
    assert [r.settings_id for r in found] == ["aa02", "aa01"]
    assert found[0].worse and "4.00 % of the problem's scale" in found[0].size


def test_rounding_is_no_change():
    """Fixed steps: 1e-9 relative is what another machine gives."""
    assert (
        list_changed_physics(
            [make_measured_record("aa01")], [make_measured_record("aa01", energy_drift_max_J=1e-3 * (1.0 + 1e-9))]
        )
        == []
    )


def test_crossing_the_benchmarks_limit_is_said():
    a, b = (make_measured_record("aa01", energy_allowed_J=1.0, energy_drift_max_J=v) for v in (0.9, 1.1))
    assert "crosses the benchmark's limit of 1.00 J" in list_changed_physics([a], [b])[0].size


def test_one_row_a_run_with_its_other_changes_beneath():
    a = make_measured_record("aa01")
    b = make_measured_record("aa01", energy_drift_max_J=0.5, phi_max=0.01, position_error_max_m=0.2)
    (row,) = list_changed_physics([a], [b])
    assert row.what == "largest energy error" and len(row.others) == 2


def test_a_column_that_one_run_never_measured_is_not_a_change():
    """Older records lack newer columns: that is the harness, not the motion."""
    before = [make_measured_record(f"a{k}", out_of_plane_max_m=math.nan) for k in range(3)]
    after = [make_measured_record(f"a{k}", out_of_plane_max_m=0.1) for k in range(3)]
    assert find_unmeasured(before, after) == ({"out_of_plane_max_m"}, set())
    assert list_changed_physics(before, after) == []


def test_work_is_a_ratio_and_timings_need_more_than_spread():
    a = make_measured_record("aa01", control="rtol", evaluations=900.0, cpu_min_s=0.9, cpu_median_s=1.0, cpu_max_s=1.6)
    b = dataclasses.replace(a, evaluations=9000.0, cpu_min_s=1.5, cpu_median_s=1.8, cpu_max_s=2.0)
    (row,) = list_changed_work([a], [b])
    assert row.size == "10.0 times" and row.worse
    assert list_changed_timings([a], [b]) == []  # their spreads touch
    (slow,) = list_changed_timings([a], [dataclasses.replace(b, cpu_min_s=1.7)])
    assert slow.rank is Rank.TIMING and slow.size == "1.80 times"


def test_changed_verdicts_say_which_way():
    before = [
        replace(CLAIM, id=k, beyond=ClaimFinding(ClaimVerdict(v)))
        for k, v in (("a", "reproduced"), ("b", "not reproduced"))
    ]
    after = [
        replace(CLAIM, id=k, beyond=ClaimFinding(ClaimVerdict(v)))
        for k, v in (("a", "not reproduced"), ("b", "reproduced if"))
    ]
    assert [(r.settings_id, r.worse) for r in list_changed_claims(before, after)] == [("a", True), ("b", False)]


@pytest.mark.parametrize(("x", "y"), [(1.0, 1.0 + 1e-7), (0.00142, 0.0014203), (3.0, 4.0)])
def test_numbers_that_differ_look_different(x, y):
    first, second = format_distinguishably(x, y)
    assert first != second


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory):
    """The same run twice; in the second one run is wrong, one is worse, one is missing, one is new."""
    a, b = tmp_path_factory.mktemp("a"), tmp_path_factory.mktemp("b")
    every_kind(a)
    every_kind(b)
    put(b, make_measured_record("aa01", status="wrong", wrong_because=because(HOSTILE)), make_swing(size=0.4))
    put(b, make_measured_record("aa02", dt_s=0.005, energy_drift_max_J=0.3), make_swing(600, size=0.3))
    (b / "runs" / "ee01.json").unlink()
    put(b, make_measured_record("zz01", case=f"new {HOSTILE}"), make_swing())
    for folder, commit in ((a, "1" * 40), (b, "2" * 40)):
        (folder / "environment.json").write_text(
            json.dumps({"run": f"run of {HOSTILE}", "commit": commit, "cpu": commit})
        )
    return a, b


def test_page_of_two_runs(two_runs, tmp_path):
    a, b = two_runs
    page = write_compare(a, b, ConfinedPath(tmp_path) / "out")
    html = page.read_text(encoding="utf-8")
    assert page == tmp_path / "out" / "compare.html"
    assert "<script>alert" not in html and HOSTILE in Outline(html).plain
    text = Outline(html).plain
    assert text.index("Endings 1 change") < text.index("Motion 1 change")
    assert "processor" in text  # an input that differs
    assert "Only in A" in text and "Only in B" in text
    for tag, attributes in Outline(html).tags:
        if tag in ("script", "link") and (target := attributes.get("src") or attributes.get("href") or ""):
            assert target.startswith("data:") or (tmp_path / "out" / target).is_file(), target
    curves = opened((tmp_path / "out" / "data" / "plots-compare.js").read_text(encoding="utf-8"))
    names = [t["name"] for p in curves["plots"].values() for t in p["traces"]]
    assert [sum(n.startswith(f"{results}: alpha") for n in names) for results in "AB"] == [2, 2]


def test_a_run_compared_with_itself_has_no_change(two_runs, tmp_path):
    a, _ = two_runs
    assert list_changes(read_results(a), read_results(a)) == {}
    text = Outline(write_compare(a, a, ConfinedPath(tmp_path)).read_text(encoding="utf-8")).plain
    assert "No input differs, and no result does." in text and "Nothing changed" in text
