"""Motions that keep every law at each instant and break one of those on their distance from the exact motion, alone."""

import json
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.registry import load_plugin
from mbsbench.harness.lab.bundle.table import make_table
from mbsbench.harness.results import records, store
from mbsbench.tests.factories import specify_run, store_run

from .test_check_bundle import checker, read, write

UPRIGHT = 20.0  # [s] about when the body has turned over twice
MOTIONS = {  # what breaks the law alone: problem, parameters, solver, step
    # 190 rad/s along the spring at 1 cm, beside a swing of 30 cm: RATTLE's phase is half a period late after 0.5 s
    "velocity": (
        "spring_pendulum",
        {"tuning": 60.0, "drop": 0.0, "aside": 0.15, "speed": 0.0, "t_end": 2.0},
        "rattle",
        {"dt": 3e-3},
    ),
    # about the axis of the middle inertia a body turns over: between the rows kept it is upside down half of the time
    "rows": (
        "torque_free_body",
        {"inertia_factors": [1.0, 2.0, 3.0], "omega": [0.001, 3.0, 0.0], "t_end": UPRIGHT},
        "tells_little",
        {"rtol": 1e-9},
    ),
}


@pytest.fixture(scope="module", params=MOTIONS)
def motion(request, tmp_path_factory):
    """A law, and the files of a lossless bundle of the motion that breaks it."""
    place = tmp_path_factory.mktemp("inaccurate")
    load_plugin(Path(__file__).parent / "forged.py")
    problem, parameters, solver, step = MOTIONS[request.param]
    folder = store.create_folder(place / "results")
    store_run(folder, specify_run(problem, solver, parameters, **step))
    assert main(["bundle", str(folder), "-o", str(place / "b.zip"), "--lossless"]) == 0
    return request.param, read(place / "b.zip")


def findings(tmp_path, files):
    with np.errstate(all="ignore"):
        return checker.Report(write(tmp_path / "b.zip", files)).findings


def test_the_harness_and_the_checker_find_the_one_law(motion, tmp_path):
    law, files = motion
    (record,) = json.loads(files["records.json"])
    assert record["status"] == "inaccurate"
    assert [reason["law"] for reason in json.loads(record["wrong_because"])] == [law]
    assert findings(tmp_path, files) == []


def test_a_success_claimed_for_it_is_found_by_that_law_alone(motion, tmp_path, monkeypatch):
    """A checker without the law says nothing of the same bundle."""
    law, files = motion
    (record,) = json.loads(files["records.json"])
    record |= {"status": "success", "wrong_because": "[]"}
    table = make_table([records.parse_record_json(json.dumps(record))])
    forged = files | {"records.json": json.dumps([record]).encode(), "table.json": json.dumps(table).encode()}
    assert {line[18:56].split()[0] for line in findings(tmp_path, forged)} == {"status", "wrong_because"}
    whole = checker.Run.list_limits
    monkeypatch.setattr(checker.Run, "list_limits", lambda run: whole(run) | {law: (0.0, 1.0)})
    assert findings(tmp_path, forged) == []
