"""Motions that break one law and whose records claim success: the checker, which sees the motion alone, finds each."""

import dataclasses
import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.registry import load_plugin, make_problem
from mbsbench.harness.judge.metrics.rows import interpolate_rows
from mbsbench.harness.lab.bundle.table import make_table
from mbsbench.harness.mechanics.types import StepControl
from mbsbench.harness.results import records, store
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.factories import specify_run, store_run

from ..harness.lab.ladder.forgeries.bundles import NEW_DIGESTS, OF_A_RUN, OF_NUMBERS, OLD_DIGESTS
from ..harness.lab.ladder.forgeries.forger import CONDUCT, COSTS
from ..harness.lab.ladder.forgeries.motions import MOTIONS, swing
from .test_check_bundle import check, checker, read, write

PARAMETERS = {"mass": 1.0, "half_length": 0.5, "omega_x": 5.0, "omega_z": 3.0, "t_end": 0.5}


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """The lossless bundle of an honest motion and of all forged ones, each judged by the harness."""
    place = tmp_path_factory.mktemp("forged")
    folder = store.create_folder(place / "results")
    load_plugin(Path(__file__).parent / "forged.py")
    for how in ("nothing", *MOTIONS):
        store_run(folder, specify_run("spherical_pendulum", "forged", PARAMETERS, {"how": how}, dt=2e-3))
    assert main(["bundle", str(folder), "-o", str(place / "b.zip"), "--lossless"]) == 0
    return read(place / "b.zip")


def forged(bundle, how, **changes):
    """The files of the bundle with one run and its exact states left, its record changed and the table made anew."""
    options = "{}" if how == "nothing" else json.dumps({"how": how})
    (record,) = (
        r for r in json.loads(bundle["records.json"]) if json.loads(r["solver_options"]) == json.loads(options)
    )
    (run,) = (r for r in json.loads(bundle["runs.json"]) if r["run_id"] == record["run_id"])
    own = (record["run_id"], run["problem"] or "none")
    kept = ("runs/", "series/", "problems/", "references/")
    files = {n: raw for n, raw in bundle.items() if not n.startswith(kept) or any(key in n for key in own)}
    for name in [n for n in files if n.startswith("references/") and run["states"] != "none"]:
        matrix, known = np.load(io.BytesIO(files[name])), list(run["peaks_s"].values())
        here = np.isin(matrix[0], [*np.load(io.BytesIO(files[f"runs/{own[0]}.npy"]))[0], *known])
        stream = io.BytesIO()
        np.save(stream, matrix[:, here])
        files[name] = stream.getvalue()
    record |= changes
    table = make_table([records.parse_record_json(json.dumps(record))])
    for name, content in (("records", [record]), ("runs", [run]), ("table", table)):
        files[f"{name}.json"] = json.dumps(content).encode()
    return files, record, run


@pytest.mark.sampled(0)
@pytest.mark.parametrize("how", ["nothing", *MOTIONS])
def test_the_checker_judges_a_forged_motion_as_the_harness_does(bundle, tmp_path, how):
    """From its states alone; and a success claimed for one that breaks a law is found, by status and reason alone."""
    files, record, run = forged(bundle, how)
    assert check(write(tmp_path / "b.zip", files)) == []
    if record["status"] in ("wrong", "inaccurate") and run["states"] != "none":
        files, *_ = forged(bundle, how, status="success", wrong_because="[]")
        assert "status" in {line[18:56].split()[0] for line in check(write(tmp_path / "b.zip", files))}


def test_the_checker_interpolates_matrices_that_are_no_rotations_as_the_harness_does():
    """At every time between rows: which of them is the largest error is decided by rounding."""
    found = swing(make_problem("spherical_pendulum", PARAMETERS), StepControl(dt=2e-3))
    random = np.random.default_rng(1)
    s = found.states
    for R in (
        s.R + 0.05 * random.standard_normal(s.R.shape),
        s.R * np.linspace(0.9, 1.1, len(s.R))[:, None, None, None],
    ):
        bent = dataclasses.replace(s, R=R)
        rows = np.concatenate([found.t[:, None], *(a.reshape(len(s), -1) for a in (s.r, R, s.v, s.Omega))], axis=1)
        at = np.linspace(0.0, found.t[-1], 501)
        ours = interpolate_rows(found.t, bent, at)
        theirs = [checker.interpolate_pose(np.insert(rows, rows.shape[1], 0.0, axis=1), t) for t in at]
        for name, place in (("r", 0), ("R", 1)):
            assert np.max(np.abs(getattr(ours, name) - np.array([one[place] for one in theirs]))) < 1e-14


def of_vector(files, run, change):
    """Replace the reactions of all steps."""
    name, (at, shape) = f"series/{run['run_id']}.npy", run["arrays"]["state_reaction"]
    values = np.frombuffer(files[name], "<f8", offset=128).copy()
    values[at : at + math.prod(shape)] = change(values[at : at + math.prod(shape)].reshape(shape)).ravel()
    files[name] = files[name][:128] + values.tobytes()


def lower(text):
    """Of the first invariant the drift is a tenth."""
    drifts = json.loads(text)
    first = next(iter(drifts.values()))
    first["max"] = 0.1 * float(first["max"])
    return json.dumps(drifts)


ONLY = {  # what is edited, and the one comparison that finds it
    "the defect of the path lowered": ({"kinematic_defect": lambda x: 0.1 * x}, "kinematic_defect"),
    "the error of reactions lowered": ({"reaction_error_max_N": lambda x: 0.1 * x}, "reaction_error_max_N"),
    "the size of reactions raised": ({"reaction_size_N": lambda x: 10.0 * x}, "reaction_size_N"),
    "the error of moments lowered": ({"moment_error_max_Nm": lambda x: 0.1 * x}, "moment_error_max_Nm"),
    "the size of moments raised": ({"moment_size_Nm": lambda x: 10.0 * x}, "moment_size_Nm"),
    "the error between steps lowered": ({"motion_between_max_m": lambda x: 0.1 * x}, "motion_between_max_m"),
    "the drift of an invariant lowered": ({"invariant_drifts": lower}, "invariant"),
}


@pytest.mark.parametrize("how", ONLY)
def test_only_one_law_finds_an_edited_number(bundle, tmp_path, how):
    """All other numbers of the record stay true."""
    changes, column = ONLY[how]
    _, record, _ = forged(bundle, "nothing")
    files, *_ = forged(bundle, "nothing", **{name: change(record[name]) for name, change in changes.items()})
    found = check(write(tmp_path / "b.zip", files))
    assert found and {line[18:56].split()[0] for line in found} == {column}


@pytest.mark.parametrize("where", ["every step", "its largest error"])
def test_scaled_reactions_are_found(bundle, tmp_path, where):
    """At every step but the one that is reported, by truncation alone; there, by the equations of motion."""
    files, _, run = forged(bundle, "nothing")
    if where == "every step":
        of_vector(files, run, lambda a: 3.0 * a)
    else:
        scaled = {k: [3.0 * x for x in a] for k, a in run["reactions"].items()}
        files["runs.json"] = json.dumps([run | {"reactions": scaled}]).encode()
    columns = {"status", "wrong_because"} if where == "every step" else {"reaction_error_max_N", "moment_error_max_Nm"}
    columns |= {"reactions"}  # beside the states it is no longer that of the series
    assert {line[18:56].split()[0] for line in check(write(tmp_path / "b.zip", files))} == columns


def test_dropped_steps_are_found(bundle, tmp_path):
    """Every other step is left out of the states: the path and its defect are not those of the record."""
    files, _, run = forged(bundle, "nothing")
    name, place = f"runs/{run['run_id']}.npy", run["arrays"]["state_reaction"]
    stream = io.BytesIO()
    np.save(stream, np.load(io.BytesIO(files[name]))[:, ::2])
    files[name] = stream.getvalue()
    of_vector(files, run, lambda a: a)
    run["arrays"]["state_reaction"] = [place[0], [(place[1][0] + 1) // 2, place[1][1]]]
    files["runs.json"] = json.dumps([run]).encode()
    assert "kinematic_defect" in {line[18:56].split()[0] for line in check(write(tmp_path / "b.zip", files))}


def test_the_page_counts_the_forgeries():
    """Each row of its table has as many kinds as the tests."""
    page = (ROOT / "docs" / "bundle.md").read_text(encoding="utf-8").partition("## Forgeries")[2]
    groups = (OLD_DIGESTS, NEW_DIGESTS, OF_A_RUN, OF_NUMBERS, COSTS, CONDUCT, MOTIONS)
    assert [int(n) for n in re.findall(r"\| (\d+) \|", page)] == [len(group) for group in groups]
