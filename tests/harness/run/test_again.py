"""A brief file keeps what is judged to the bit; every step is solved again on demand, or refused."""

import dataclasses

import numpy as np
import pytest

from mbsbench.cli.full_series import find_brief_runs
from mbsbench.cli.progress import run_watched
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue import codes
from mbsbench.harness.catalogue.suites.suite import Suite
from mbsbench.harness.lab.bundle.contents import list_contents
from mbsbench.harness.results import store
from mbsbench.harness.results.envelopes import FEW, find_spans
from mbsbench.harness.run import full_series
from mbsbench.harness.run.full_series import solve_every_step
from mbsbench.harness.run.runner import Request
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.factories import specify_run

RUNS = (
    ("heavy_top", {"t_end": 1.0}, "gc_weak_form", {"dt": 0.001}),
    ("spherical_pendulum", {"omega_z": 0.1, "t_end": 5.0}, "rkmk_dopri5", {"rtol": 1e-9}),
    ("chain", {"t_end": 0.5}, "gc_weak_form", {"dt": 0.001}),
    ("four_bar_grid", {"t_end": 0.5}, "rattle", {"dt": 0.001, "max_steps": 450}),  # stops early
    ("four_bar_grid", {"t_end": 0.2}, "rattle", {"dt": 0.01}),  # short
)
KEPT = ("energy_error", "obs_C_*")


def run_all(folder, keep):
    specs = tuple(specify_run(p, s, q, **c) for p, q, s, c in RUNS)
    request = Request(Suite("some", "a few runs", specs, ""), folder, 1, choose_rows=keep and (lambda spec: keep))
    run_watched(request, quiet=True)
    return {r.settings_id: r for r in store.load(folder).records}


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full") / "run"
    return folder, run_all(folder, None)


@pytest.fixture(scope="module")
def brief(tmp_path_factory):
    folder = tmp_path_factory.mktemp("brief") / "run"
    return folder, run_all(folder, KEPT)


@pytest.fixture(scope="module")
def pairs(full, brief):
    """Each run with both of its series."""
    found = [
        (r, store.read_run_series(full[0], r), store.read_run_series(brief[0], brief[1][s])) for s, r in full[1].items()
    ]
    assert len(found) == len(RUNS)
    return found


def solve_again(folder, records, place, **how):
    return solve_every_step(folder, records, place, 1, lambda request: run_watched(request, quiet=True), **how)


def test_each_envelope_contains_each_step(pairs):
    """Nothing that a step did is outside of what is drawn; series that are kept have the bits of the full file."""
    enveloped = 0
    for record, whole, series in pairs:
        assert series.is_brief and not whole.is_brief
        assert bool(series.envelopes) == (record.steps >= FEW)
        assert series["t"].tobytes() == whole["t"].tobytes() and series["dt"].tobytes() == whole["dt"].tobytes()
        for name, e in series.envelopes.items():
            enveloped += 1
            values = whole[name] if name in whole else whole[f"obs_{name[5:]}"] - whole[f"ref_{name[5:]}"]
            good = np.isfinite(values)
            span = find_spans(whole["t"][good], e.begin, e.end, len(e.low))
            assert_each(e.low[span], "<=", values[good], what=name)
            assert_each(values[good], "<=", e.high[span], what=name)
            if record.status == "stalled":
                assert_same(series.tail(name, 9), values[-9:], equal_nan=True, what=name)
        same = {k for k in series.arrays if k in whole.arrays and series[k].shape == whole["t"].shape}
        assert {"energy_error", "t", "dt"} <= same
        assert all(series[k].tobytes() == whole[k].tobytes() for k in same)
    assert enveloped > 40


def test_poses_are_as_near_as_pages_allow(pairs):
    """Between the poses kept, the bodies of the full file are at most 0.005 of a body off, and 0.015 rad."""
    from mbsbench.reports.mechanism.theatre.poses import Poses, _compare_poses, interpolate_poses

    for _, whole, series in pairs:
        ours, theirs = (Poses(s["frame_t"], s["frame_r"].astype(float), s["frame_q"]) for s in (series, whole))
        span = np.linalg.norm(whole["joint_s_i"], axis=1).max()
        distance, angle = _compare_poses(interpolate_poses(ours, theirs.t), theirs)
        assert np.max(distance) < 0.01 * span + series.length * 4e-4 and np.max(angle) < 0.015


def test_a_bundle_is_the_same_from_either_file(full, brief):
    """States that a bundle takes are in the brief file, and the exact ones beside them, to the bit."""
    (_, a), (_, b) = full, brief
    assert [r.code for r in a.values()] == [b[s].code for s in a]
    left, right = (dict(list_contents(folder, records.values(), lossless=False)) for folder, records in (full, brief))
    assert left.keys() == right.keys() and sum(k.startswith("runs/") for k in left) == len(RUNS)
    for name in left:
        if name.startswith(("runs/", "references/", "problems/", "runs.json")):  # records and the table have times
            assert left[name] == right[name], name


def test_steps_on_demand_are_those_of_the_run_bit_for_bit(full, brief, tmp_path):
    """Rows of a run made with all its steps, against those solved again for a run that kept envelopes."""
    folder, records = brief
    assert {r.run_id for r in find_brief_runs(folder, list(records.values()))} == {r.run_id for r in records.values()}
    assert find_brief_runs(full[0], list(full[1].values())) == []
    found = solve_again(folder, list(records.values()), tmp_path / "again", lossless=False)
    for settings, record in records.items():
        whole, series = store.read_run_series(full[0], full[1][settings]), found[record.run_id]
        rows = [k for k, a in whole.arrays.items() if a.shape == whole["t"].shape]
        assert len(rows) > 12 and len(series["t"]) == record.steps + 1
        assert all(series[k].tobytes() == whole[k].tobytes() for k in rows)
        assert series.steps_sha256 == whole.steps_sha256


def test_a_lossless_bundle_holds_every_step_of_brief_results(brief, tmp_path):
    """States are solved again, each with its velocities and reactions."""
    import json

    folder, records = brief
    own = list(records.values())[:1]
    found = solve_again(folder, own, tmp_path / "again")
    files = dict(list_contents(folder, own, lossless=True, again=found))
    (run,) = json.loads(files["runs.json"])
    assert run["states"] == "every step"


def test_a_run_that_a_clock_ended_is_followed_to_its_last_step(brief, tmp_path):
    """Where it stopped depends on the machine, what it did until then does not."""
    folder, records = brief
    record = next(r for r in records.values() if r.status == "stalled")
    spec = specify_run(RUNS[3][0], "rattle", RUNS[3][1], dt=0.001)
    ended = dataclasses.replace(
        record, settings_id=spec.settings_id, max_steps=10_000_000, ended_by="cpu_limit", status="unfinished"
    )
    found = solve_again(folder, [ended], tmp_path / "again")
    assert len(found[record.run_id]["state_t"]) == 451


@pytest.mark.parametrize("what", ["code", "platform", "bits"])
def test_steps_are_refused_where_they_would_not_be_those_of_the_run(brief, tmp_path, monkeypatch, what):
    """One line says which run and what differs; by code and platform nothing is solved first."""
    folder, records = brief
    record = next(iter(records.values()))
    if what == "code":
        monkeypatch.setattr(codes, "digest_run_code", lambda *of: "of another commit")
        expected = "is of code .*, this is of another commit"
    elif what == "platform":
        own = full_series.origin.describe_environment("", "", 1, ())
        monkeypatch.setattr(full_series.origin, "describe_environment", lambda *of: {**own, "libc": "glibc 1.0"})
        expected = "C library .* -> glibc 1.0"
    else:
        series = store.read_run_series(folder, record)
        monkeypatch.setattr(
            full_series.store,
            "read_run_series",
            lambda where, r, **how: dataclasses.replace(series, steps_sha256="0" * 64 if where == folder else "1" * 64),
        )
        expected = "its steps are not bit for bit"
    with pytest.raises(FileError, match=expected) as refused:
        solve_again(folder, [record], tmp_path / "again", lossless=False)
    assert record.run_id[:8] in str(refused.value) and "\n" not in str(refused.value)
    assert (tmp_path / "again").exists() == (what == "bits")
