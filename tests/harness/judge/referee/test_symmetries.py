"""The scorecard separates symmetries that a solver keeps from those it breaks, planted breaks among them."""

import dataclasses
import json

import numpy as np
import pytest
from msgspec.structs import replace

from mbsbench.harness.base.files import FileError
from mbsbench.harness.judge.invariance import Yardstick
from mbsbench.harness.judge.referee.certificates import symmetries
from mbsbench.harness.judge.referee.certificates.symmetries import _judge_deviation, _prepare_row, check_symmetries
from mbsbench.harness.judge.referee.false_successes import find_false_successes, measure_own_error
from mbsbench.harness.judge.referee.weighing import list_deciding_runs, weigh_published
from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results.judgements.files import format_judgement
from mbsbench.harness.results.judgements.runs import FalseSuccess, Unjudged
from mbsbench.harness.results.store import create_folder
from mbsbench.harness.run.job import Job
from mbsbench.reports.pages.judged.symmetries import describe_symmetry
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.factories import change_series, make_record, specify_run
from mbsbench.tests.factories import run_here as run

START = {"t_end": 0.5, "omega_z": 3.0}
PENDULUM = "spherical_pendulum"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return create_folder(tmp_path_factory.mktemp("told"))


@pytest.fixture(scope="module")
def told(folder):
    """Records of a solver on the spatial pendulum, as it stands, its yardsticks, and told as asked."""
    known = {}

    def of(*ways, solver="gc_weak_form", problem=PENDULUM, start=START, **options):
        fixed = solver.startswith("gc")
        steps = {"dt": 0.01} if fixed else {"rtol": 1e-6}
        finer = {"dt": 0.005} if fixed else {"rtol": 1e-7}
        tight = {**options, "tolerance": 1e-9} if fixed else options
        asked = [({}, options, steps), ({}, options, finer), ({"perturb": 1e-10}, options, steps)]
        asked += [({}, tight, steps)] * fixed + [(way, options, steps) for way in ways]
        out = []
        for way, chosen, step in asked:
            spec = specify_run(problem, solver, {**start, **way}, chosen, **step)
            if spec.settings_id not in known:
                known[spec.settings_id] = run(Job(spec, folder))
            out.append(known[spec.settings_id])
        return out

    return of


def card(folder, records):
    return {e.title: e for e in check_symmetries(folder, records)}


WAYS = ({"yaw": 0.7}, {"mirror": "X"}, {"retrace": True}, {"unit_mass": 1024.0}, {"renumber": 1})


def test_the_weak_form_keeps_its_symmetries_exactly(folder, told):
    """Frame about the vertical, mirror and the way back: as far as its steps are solved; one body has no order."""
    found = card(folder, told(*WAYS))
    for check in ("mirror image", "time reversal", "unit of mass x 1024"):
        assert found[check].verdict == "holds", describe_symmetry(found[check])
        assert found[check].exact, describe_symmetry(found[check])
    assert found["yaw"].verdict == "holds"
    assert found["renumbering"].verdict == "not applicable"


def test_a_one_sided_gauge_does_not_retrace_exactly(folder, told):
    """Break the physics: the zero gauge is second order all the same, but its way back is another one."""
    entry = card(folder, told({"retrace": True}, gauge="zero"))["time reversal"]
    assert entry.exact is False, describe_symmetry(entry)
    assert "not exactly" in describe_symmetry(entry) or entry.verdict == "broken"


def test_the_direction_decides_about_frames_and_units(folder, told):
    """c_R = a / (a . a) adds metres to numbers and goes by the axes of space; (e_k, 0) does neither."""
    ways = ({"rotation": [0.3, -0.5, 0.7]}, {"unit_length": 1024.0})
    plain, sound = card(folder, told(*ways)), card(folder, told(*ways, direction="translation"))
    for check in ("rotation", "unit of length x 1024"):
        assert plain[check].exact is False
        assert sound[check].exact is True, describe_symmetry(sound[check])


def test_an_error_controlled_solver_is_held_to_its_tolerance(folder, told):
    """All hold; nothing is said of exactness, as its steps differ."""
    found = card(folder, told(*WAYS[:3], {"duplicate": 1}, solver="ida_index1"))
    assert {e.verdict for e in found.values()} == {"holds"}, found
    assert {e.exact for e in found.values()} == {None}


def test_planar_motion_stays_planar_however_it_is_presented(folder, told):
    """As it stands and yawed, each a row of its own."""
    found = card(folder, told({"yaw": 0.7}, start={"t_end": 0.5}))
    for check in ("planar symmetry", "planar symmetry, yaw"):
        assert found[check].verdict == "holds", describe_symmetry(found[check])


def test_a_planted_deviation_is_broken_and_wrong_though_it_succeeds(folder, told):
    """A run that is told in another frame but ends where another motion does."""
    records = told({"mirror": "X"})
    stranger = next(r for r in told({"yaw": 0.7}) if "yaw" in r.problem_parameters)
    off = {"motion_error_judged_m": 0.1 * stranger.length_scale_m}
    planted = dataclasses.replace(records[-1], series=stranger.series, series_sha256=stranger.series_sha256, **off)
    entry = card(folder, [*records[:-1], planted])["mirror image"]
    assert entry.verdict == "broken"
    assert entry.deviation > entry.bound
    told_of = [*records[:-1], planted]
    found = find_false_successes(told_of, check_symmetries(folder, told_of))
    assert [e.settings_id for e in found] == [planted.settings_id]
    assert [(b.law, b.name) for b in found[0].because] == [(Law.SYMMETRY, "mirror image")]
    assert find_false_successes(records, check_symmetries(folder, records)) == ()


def test_a_symmetry_that_a_right_motion_breaks_is_a_finding_of_its_own(folder, told):
    """ODE-GC's direction goes by the axes of space: turned, the pendulum errs by more than three halvings explain.

    Both motions are right to a thousandth of their size. No two ends are farther apart than the sum of their errors.
    """
    records = told({"rotation": [0.3, -0.5, 0.7]}, start={"t_end": 1.0})
    base, turned = records[0], records[-1]
    entry = card(folder, records)["rotation"]
    assert entry.verdict == "broken" and entry.misleads is False, describe_symmetry(entry)
    assert find_false_successes(records, check_symmetries(folder, records)) == ()
    errors = [measure_own_error(entry, r) for r in (base, turned)]
    assert entry.deviation <= sum(errors) and max(errors) < 1e-3 * base.length_scale_m
    off = dataclasses.replace(turned, motion_error_judged_m=0.05 * base.length_scale_m)
    found = find_false_successes([off], check_symmetries(folder, [*records[:-1], off]))
    assert [b.law for w in found for b in w.because] == [Law.SYMMETRY]


def test_published_verdicts_are_weighed_by_the_runs_that_decide(folder, told):
    """What nobody is misled by goes; a false success by its energy stays without a run; another run is refused."""
    records = told({"rotation": [0.3, -0.5, 0.7]}, start={"t_end": 1.0})
    rows = tuple(replace(s, misleads=None, own_error=float("nan")) for s in check_symmetries(folder, records))
    other = FalseSuccess("a", "a", "s", "p", (Reason(Law.ENERGY, 2.0, 1.0, "J"),))
    accused = FalseSuccess("b", records[-1].settings_id, "s", "p", (Reason(Law.SYMMETRY, 2.0, 1.0, "m"),))
    broken = [s for s in rows if s.verdict == "broken"]
    assert list_deciding_runs(rows, (other, accused)) == {k for s in broken for k in s.settings_ids}
    weighed, found = weigh_published(folder, records, rows, (other, accused))
    assert found == (other,) and same_rows(weighed, check_symmetries(folder, records))
    misled = [dataclasses.replace(r, motion_error_judged_m=0.05 * r.length_scale_m) for r in records]
    rows_of_misled, still = weigh_published(folder, misled, rows, (other, accused))
    assert {w.settings_id for w in still} == {"a", records[-1].settings_id}
    assert all(s.misleads for s in rows_of_misled if s.verdict == "broken")
    with pytest.raises(FileError, match="lacks 1 of 2 runs"):
        weigh_published(folder, records[:-1], rows, (other, accused))
    changed = tuple(replace(s, deviation=1.001 * s.deviation) for s in rows)
    with pytest.raises(FileError, match="is not the published run"):
        weigh_published(folder, records, changed, (other, accused))
    rates = FalseSuccess("b", records[-1].settings_id, "s", "p", (Reason(Law.TRUNCATION, 2.0, 1.0),))
    with pytest.raises(FileError, match="is not the published run"):
        weigh_published(folder, records, rows, (rates,))


def same_rows(one, other):
    """Whether rows are equal, NaN to NaN."""
    return format_judgement(one) == format_judgement(other)


def test_refusals_failures_and_missing_ways_back_are_distinguished(folder, told):
    """Each with the solver's own words."""
    records = told({"duplicate": 1}, {"retrace": True})
    found = card(folder, records)
    assert found["repeated joint"].verdict == "refused"
    assert "rank 3" in describe_symmetry(found["repeated joint"])
    note = json.dumps(["the way back ended with diverged at 0.1 s: no"])
    lost = dataclasses.replace(records[-1], notes=note, return_error_m=float("nan"), return_error_rad=float("nan"))
    failed = dataclasses.replace(records[-1], status="diverged", claimed="diverged", message="no")
    assert card(folder, [*records[:-1], lost])["time reversal"].verdict == "failed"
    assert "the way back" in describe_symmetry(card(folder, [*records[:-1], lost])["time reversal"])
    assert card(folder, [*records[:-1], failed])["time reversal"].verdict == "failed"


def test_without_a_yardstick_nothing_is_judged(folder, told):
    """A deviation without a bound is no finding."""
    records = told({"mirror": "X"})
    assert check_symmetries(folder, [records[0], records[-1]]) == ()


NAN = float("nan")


@pytest.mark.parametrize("column", ["return_error_m", "return_error_rad"])
def test_half_a_way_back_is_none(folder, told, column):
    """Distance and angle are both needed, whichever is not a number."""
    records = told({"retrace": True})
    lost = dataclasses.replace(records[-1], **{column: NAN})
    assert card(folder, [*records[:-1], lost])["time reversal"].verdict == "failed"


@pytest.mark.parametrize("pose", ["end_r", "end_R", ""])
@pytest.mark.parametrize("whose", [-1, 1, 2, 3])
def test_what_has_no_end_pose_is_no_success_of_a_check(folder, told, monkeypatch, whose, pose):
    """Not a number in the run told otherwise, at half the step, from the changed start, at a tenth: nothing holds.

    Nor does it where the file of the series is lost.
    """
    records = told({"mirror": "X"})
    read = symmetries.store.read_run_series

    def series_of(where, r):
        if r.run_id != records[whose].run_id:
            return read(where, r)
        return change_series(read(where, r), **{pose: np.full_like(read(where, r)[pose], NAN)}) if pose else None

    monkeypatch.setattr(symmetries.store, "read_run_series", series_of)
    entry = card(folder, records)["mirror image"]
    assert entry.verdict == "failed", describe_symmetry(entry)
    assert entry.unjudged in (Unjudged.END, Unjudged.BOUND)


def test_a_bound_above_the_size_decides_nothing_and_a_broken_row_says_by_how_much():
    """Any two ends of a mechanism are closer than that; 4 m of 2 m allowed is twice as much."""
    wide, narrow = Yardstick(0.2, 0.0, 1.0, 100, 1.0), Yardstick(0.02, 0.0, 1.0, 100, 1.0)
    base = make_record(solver_options="{}", case="p s")

    def made(deviation, yard):
        return _judge_deviation(_prepare_row(base, "yaw"), deviation, yard)

    assert made(0.5, wide).verdict == "undecided"
    assert made(0.1, narrow).verdict == "holds"
    broken = made(0.4, narrow)
    assert broken.verdict == "broken" and "2 times the 2.0e-01 m allowed" in describe_symmetry(broken)
    assert made(0.201, narrow).verdict == made(0.219, narrow).verdict == "undecided"  # the bound is known to a tenth
    assert made(0.221, narrow).verdict == "broken"
    exact = Yardstick(1e-6, 5.0, 1.0, 100, 1.0)  # half the step decides nothing, but it is kept exactly
    assert made(1e-6, exact).verdict == "holds"
    assert made(1e-4, exact).verdict == "undecided"


def test_the_tighter_run_has_the_same_largest_step_and_is_chosen_by_its_settings(folder, told):
    """Another largest step is another run; of two tighter ones the one at a tenth, whichever ended last."""
    solver = {"solver": "ida_index1"}
    records = told({"mirror": "X"}, **solver)
    tighter = records[1]
    other = dataclasses.replace(tighter, max_step_s=0.01, settings_id="0", run_id="0", finished="0")
    coarse = dataclasses.replace(
        tighter,
        rtol=1.5e-7,
        settings_id="1",
        run_id="1",
        series=records[0].series,
        series_sha256=records[0].series_sha256,
    )
    alone = card(folder, records)["mirror image"]
    for finished in ("0", "9"):
        coarse = dataclasses.replace(coarse, finished=finished)
        assert card(folder, [*records, other, coarse])["mirror image"].bound == alone.bound
    assert check_symmetries(folder, [records[0], other, *records[2:]]) == ()


def test_growth_is_the_motions_own(folder, told):
    """Under error control a changed start moves the steps too; the least growth of all solvers is the motion's."""
    loose = told({"retrace": True}, solver="ida_index1")
    moved = [
        dataclasses.replace(r, series=loose[1].series, series_sha256=loose[1].series_sha256)
        if "perturb" in r.problem_parameters
        else r
        for r in loose
    ]
    by = {e.solver: e.bound for e in check_symmetries(folder, [*told({"retrace": True}), *moved])}
    alone = card(folder, moved)["time reversal"].bound
    assert by["ida_index1"] < 0.1 * alone


def test_rounding_and_growth_make_the_bound_where_a_tolerance_moves_nothing():
    """Steps times rounding times growth: 1000 steps grown a hundredfold give 2e-10 of the size."""
    yard = Yardstick(level=0.0, halved=0.0, growth=100.0, steps=1000, size=1.0)
    assert yard.bound == pytest.approx(10.0 * 2.2e-16 * 1000 * 100.0)
    assert yard.return_factor == 101.0
    assert_close(Yardstick(1e-6, 1e-3, 1.0, 100, 1.0).bound, 1e-5 + 3e-3)
