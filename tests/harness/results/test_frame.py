"""Runs as one typed frame: settings are columns, and no reader parses JSON."""

import json
import math
import pickle
import re

import pytest

from mbsbench.harness.base.files import FileError
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.frame import make_frame
from mbsbench.harness.results.records import JSON_COLUMNS, Deviation, RunRecord
from mbsbench.tests.factories import make_record

DRIFT = {"max": "inf", "end": 2.0, "start": -1.0, "unit": "J"}
RUNS = (
    make_record(
        problem="chain",
        problem_parameters='{"links": 6, "rotation": [0.1, 0.2, 0.3]}',
        solver_options='{"gauge": "symmetric", "tolerance": 1e-9}',
        counters='{"steps": 7}',
        notes='["a", "b"]',
        observable_errors=json.dumps({"theta": {"max": 0.5, "end": 0.25, "unit": "rad"}}),
        invariant_drifts=json.dumps({"E": DRIFT}),
    ),
    make_record(problem="chain", solver_options='{"gauge": "minimal"}'),
)


def test_settings_are_columns_with_their_own_values():
    """As they were given: numbers stay numbers; what a run does not have is missing, and all other columns stay."""
    frame = make_frame(RUNS)
    assert frame["parameter.links"].tolist() == [6, None]
    assert frame["option.gauge"].tolist() == ["symmetric", "minimal"]
    assert frame["option.tolerance"].tolist() == [1e-9, None] and frame["count.steps"].tolist() == [7, None]
    assert frame["parameter.rotation"][0] == [0.1, 0.2, 0.3]
    assert frame["observable.theta"][0] == 0.5 and math.isinf(frame["invariant.E"][0])
    assert frame["observable.theta"].dtype == frame["invariant.E"].dtype == "float64"
    assert math.isnan(frame["observable.theta"][1])
    plain = store.table(RUNS)
    same = [c for c in plain if c in frame]
    assert frame[same].equals(plain[same])
    assert set(plain) - set(frame) == JSON_COLUMNS.keys() - {"notes"}
    assert make_frame(()).empty and list(make_frame(())) == same


def test_a_record_has_its_json_as_typed_properties():
    """Each is parsed once, read-only, and of a text that is damaged the record says which column it is."""
    r = RUNS[0]
    assert r.parameters == {"links": 6, "rotation": [0.1, 0.2, 0.3]} and r.note_lines == ("a", "b")
    assert r.invariants == {"E": Deviation(math.inf, 2.0, -1.0, "J")} and r.counts == {"steps": 7}
    assert math.isnan(r.observables["theta"].start) and r.reasons == ()
    assert r.options is r.options and RunRecord(solver_options=r.solver_options).options is r.options
    with pytest.raises(TypeError):
        r.options["gauge"] = "other"
    with pytest.raises(FileError, match="column counters"):
        make_record(counters="[]").counts  # noqa: B018
    assert make_record(counters="{}") == make_record(counters="{}") and r.invariants and r == RUNS[0]


def test_one_place_parses_the_columns_of_records_that_are_json():
    """Others read the properties of a record: no call of a JSON parser names one of these columns."""
    columns = "|".join((*JSON_COLUMNS, "wrong_because"))
    call = re.compile(rf"(?:loads|parse_json|parse_reasons)\([^\n]*\b(?:{columns})\b")
    rooms = ("harness", "cli", "reports", "solvers", "problems")
    files = [p for room in rooms for p in (ROOT / room).rglob("*.py")] + list(ROOT.glob("*.py"))
    found = {p.relative_to(ROOT).as_posix() for p in files if call.search(p.read_text(encoding="utf-8"))}
    assert found == {"harness/results/records.py"}


def test_a_record_goes_to_another_process_as_its_columns():
    """Pages are written by two: what was parsed is no part of a record, and is read-only there as here."""
    record = make_record(problem_parameters='{"links": 3}')
    assert record.parameters == {"links": 3}
    other = pickle.loads(pickle.dumps(record))
    assert vars(record).keys() == vars(other).keys() == vars(RunRecord()).keys() and other.parameters == {"links": 3}
