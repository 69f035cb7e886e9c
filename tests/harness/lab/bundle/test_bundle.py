"""A bundle is what docs/bundle.md says, has the same bytes each time, and shows every change."""

import dataclasses
import hashlib
import io
import json
import re
import shutil
import zipfile

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.lab.bundle.archive import MANIFEST, NAME, write_archive
from mbsbench.harness.lab.bundle.crate import METADATA
from mbsbench.harness.results import selection, store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.selection import DECIDING, ERRORS
from mbsbench.harness.results.series import read_series, write_series
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import specify_run, store_run

RUNS = (
    ("heavy_top", {"t_end": 0.2}, "rattle", {"dt": 0.002}),
    ("heavy_top", {"t_end": 0.2}, "rkmk_dop853", {"rtol": 1e-6}),
    ("rolling_disc", {"t_end": 0.1}, "gc_weak_form", {"dt": 0.01}),
    ("chain", {"t_end": 0.3, "yaw": 0.7}, "gc_weak_form", {"dt": 0.005}),  # of 15 bodies: not all maxima fit
    ("four_bar_grid", {"t_end": 0.1}, "gc_weak_form", {"dt": 0.01}),  # refused: no motion
)
BODIES = ("r", "R", "v", "Omega")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = store.create_folder(tmp_path_factory.mktemp("results") / "run")
    for problem, parameters, solver, control in RUNS:
        store_run(folder, specify_run(problem, solver, parameters, **control))
    return folder


def bundle(folder, out, *more):
    assert main(["bundle", str(folder), "-o", str(out), *more]) == 0
    return out


@pytest.fixture(scope="module", params=["thinned", "lossless"])
def made(request, results, tmp_path_factory):
    return bundle(results, tmp_path_factory.mktemp("b") / "b.zip", *(["--lossless"] * (request.param == "lossless")))


def contents(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def changes(path):
    """Where a bundle differs from its manifest."""
    files = contents(path)
    told = {
        name: digest for digest, name in (line.split("  ", 1) for line in files.pop(MANIFEST).decode().splitlines())
    }
    found = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    return sorted(name for name in {*told, *found} if told.get(name) != found.get(name))


def unpacked(vector, index):
    """The arrays of one vector, as the page says."""
    flat = np.load(io.BytesIO(vector), allow_pickle=False)
    assert flat.dtype == np.dtype("<f8") and flat.ndim == 1
    return {name: flat[at : at + int(np.prod(shape))].reshape(shape) for name, (at, shape) in index.items()}


def states_of(matrix):
    """The states of one matrix, as the page says."""
    t, *bodies, stated = np.load(io.BytesIO(matrix), allow_pickle=False)
    each = np.array(bodies).T.reshape(len(t), -1, 18)
    r, R, v, Omega = np.split(each, (3, 12, 15), axis=2)
    return {"t": t, "r": r, "R": R.reshape(*r.shape, 3), "v": v, "Omega": Omega, "stated": stated}


def states_of_run(files, run):
    return states_of(files[f"runs/{run['run_id']}.npy"]) if run["states"] != "none" else {}


@pytest.mark.sampled(0)
def test_two_bundles_of_a_folder_have_the_same_bytes(results, made, tmp_path):
    """Wherever the folder is, and whenever: no time, path, order of files or compressor enters."""
    moved = shutil.copytree(results, tmp_path / "elsewhere")
    lossless = json.loads(contents(made)["bundle.json"])["lossless"]
    again = bundle(moved, tmp_path / "again.zip", *(["--lossless"] * lossless))
    assert again.read_bytes() == made.read_bytes()


def test_the_manifest_shows_every_change(made, tmp_path):
    """Of any byte of any file, of a file that is gone, and of one more."""
    assert changes(made) == []
    files = contents(made)

    def changed(**more):
        with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
            for name, content in {**files, **more}.items():
                if content is not None:
                    archive.writestr(name, content)
        return changes(tmp_path / "x.zip")

    for name, content in files.items():
        if name != MANIFEST:
            assert changed(**{name: content[:-1] + bytes([content[-1] ^ 1])}) == [name]
    assert changed(**{"records.json": None, "more.json": b"{}"}) == ["more.json", "records.json"]


def test_a_bundle_holds_the_records_and_states_of_its_results(results, made):
    """Every number comes back bit for bit; what is thinned is left out, never altered."""
    files = contents(made)
    records = {r.run_id: r for r in store.load(results).records}
    told = json.loads(files["records.json"])
    assert [r["run_id"] for r in told] == sorted(records)
    assert all(
        float(r["energy_drift_max_J"]) == pytest.approx(records[r["run_id"]].energy_drift_max_J, nan_ok=True)
        for r in told
    )
    lossless = json.loads(files["bundle.json"])["lossless"]
    for run in json.loads(files["runs.json"]):
        series = store.read_run_series(results, records[run["run_id"]])
        states = states_of_run(files, run)
        assert bool(states) == (series is not None)
        if series is None:
            continue
        kept = np.isin(series["state_t"], states["t"])
        assert run["states"] == ("every step" if lossless else "some steps") and (kept.all() == lossless)
        for name in BODIES:
            assert_same(states[name], series[f"state_{name}"][kept])
        rows = np.isin(series["t"], states["t"])
        assert_same(states["stated"], series["energy_error"][rows], equal_nan=True)
        assert bool(run["arrays"]) == lossless
        if lossless:
            more = unpacked(files[f"series/{run['run_id']}.npy"], run["arrays"])
            assert_same(more["phi_norm"], series["phi_norm"])
            assert "t" in more
        problem = json.loads(files[f"problems/{run['problem']}.json"])
        exact = states_of(files[f"references/{run['problem']}.npy"])
        times, at, there = np.intersect1d(exact["t"], series["sample_t"], return_indices=True)
        assert_same(exact["R"][at], series["sample_R"][there])
        assert len(times)
        if lossless:
            assert_same(times, series["sample_t"])
        system = make_problem(problem["problem"], problem["parameters"]).system
        for name in ("mass", "inertia", "joint_s_i", "joint_n", "joint_motion"):
            assert_same(np.array(problem["numbers"][name]).reshape(getattr(system, name).shape), getattr(system, name))
    assert len([n for n in files if n.startswith("problems/")]) == 3  # two runs share one


def test_thinned_states_are_those_of_the_maxima_that_decide_as_far_as_they_fit(results, tmp_path, monkeypatch):
    """A run's states take no more than their room, so that a suite of hundreds of runs fits into megabytes."""
    monkeypatch.setattr(selection, "ROOM", room := 6_000)
    files = contents(bundle(results, tmp_path / "b.zip"))
    left_out = 0
    for run in json.loads(files["runs.json"]):
        if run["states"] == "none":
            continue
        states = states_of_run(files, run)
        exact = states_of(files[f"references/{run['problem']}.npy"])["t"]
        peaks = run["peaks_s"]
        assert {at for name, at in peaks.items() if name.startswith("scale ")} <= {*exact}
        assert 8 * sum(np.count_nonzero(states[name]) for name in BODIES) <= room
        missing = {name for name in DECIDING if name in peaks and peaks[name] not in states["t"]}
        assert not missing & {"motion_error_judged_m", "energy_share_max", "gap_share_max"}
        assert all(peaks[name] in exact for name in ERRORS if name in peaks and name not in missing)
        left_out += len(missing)
    assert left_out


def test_an_error_at_the_last_step_claims_no_pair_of_steps(results):
    """A series that is thinned has the last step without the one before it."""
    series = read_series(next((results / "series").glob("*.npz")))
    t = series["state_t"]
    for at, both in ((0.5 * (t[1] + t[2]), True), (t[-1], False)):
        moved = dataclasses.replace(series, peaks={selection.BETWEEN: float(at)})
        assert selection.select_states(moved)[2] is both


def test_the_page_lists_every_file_and_array(made):
    """Names in backticks of the tables, and nothing else is written."""
    page = (ROOT / "docs" / "bundle.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"`([^`]+)`", page))
    files = contents(made)
    hidden = {re.sub(r"[0-9a-f]{16}", "<id>", n) for n in files}
    names = {re.sub(r"\.[0-9a-f]{12}\.", ".<id>.", n).replace("s/<id>.npy", "s/<run_id>.npy") for n in hidden}
    names = {n.replace("references/<run_id>", "references/<id>") for n in names}
    assert names <= listed
    assert {
        "records.json",
        "runs.json",
        "bundle.json",
        METADATA,
        MANIFEST,
        "runs/<run_id>.npy",
        "problems/<id>.json",
        "references/<id>.npy",
    } <= names
    runs = json.loads(files["runs.json"])
    for entry in (*runs, json.loads(files["bundle.json"])):
        assert set(entry) <= listed
    for run in runs:
        if run["problem"]:
            problem = json.loads(files[f"problems/{run['problem']}.json"])
            assert {*problem, *problem["numbers"], *problem["reference"]} <= listed


def test_the_metadata_is_an_ro_crate(made):
    """The rules of RO-Crate 1.1: descriptor, root data entity, and a data entity for each part."""
    files = contents(made)
    crate = json.loads(files[METADATA])
    entities = {e["@id"]: e for e in crate["@graph"]}
    assert len(entities) == len(crate["@graph"]) and crate["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    about, root = entities[METADATA], entities["./"]
    assert about["@type"] == "CreativeWork" and about["about"] == {"@id": "./"}
    assert about["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert root["@type"] == "Dataset" and re.fullmatch(r"\d{4}-\d\d-\d\d", root["datePublished"])
    assert all(root[name] for name in ("name", "description", "license"))
    parts = {p["@id"] for p in root["hasPart"]}
    assert parts == files.keys() - {METADATA, MANIFEST}
    for name in parts:
        entity = entities[name]
        assert entity["@type"] == "File" and entity["contentSize"] == str(len(files[name]))
        assert entity["sha256"] == hashlib.sha256(files[name]).hexdigest()

    def targets(value):
        if isinstance(value, dict):
            yield from [value["@id"]] if set(value) == {"@id"} else [t for v in value.values() for t in targets(v)]
        elif isinstance(value, list):
            for v in value:
                yield from targets(v)

    linked = {t for e in crate["@graph"] for k, v in e.items() if k != "conformsTo" for t in targets(v)}
    assert linked <= entities.keys()


@pytest.mark.parametrize("name", ["../x", "/x", "a//b", "a/../b", "C:\\x", ".x", "a\nb", "", "a/", "CON\0"])
def test_a_hostile_name_is_never_written(tmp_path, name):
    with pytest.raises(FileError):
        write_archive(tmp_path / "b.zip", [(name, b"")])
    assert not list(tmp_path.iterdir())
    assert NAME.fullmatch("runs/0123456789abcdef.npy")


def test_a_record_with_another_id_and_a_series_without_whole_states_are_refused(results, tmp_path, capsys):
    moved = shutil.copytree(results, tmp_path / "run")
    (record,) = [r for r in store.load(moved).records if r.solver == "rattle"]
    series = store.read_run_series(moved, record)
    broken = {k: a for k, a in series.arrays.items() if k != "state_R"}
    digest = write_series(moved / record.series, type(series)(broken, *list(vars(series).values())[1:]))
    store.write_record(moved, dataclasses.replace(record, series_sha256=digest))
    assert main(["bundle", str(moved), "-o", str(tmp_path / "b.zip")]) == 2
    assert "run it again" in capsys.readouterr().err
    assert not (tmp_path / "b.zip").exists()
