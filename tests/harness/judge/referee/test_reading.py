"""What claims and drift read of a run is known before it is made, so that its results keep it."""

import numpy as np
import pytest

from mbsbench.harness.judge.referee.claims.measures import MEASURES, evaluate, list_series_read
from mbsbench.harness.judge.referee.claims.register import read_register
from mbsbench.harness.judge.referee.judge import list_tried_runs
from mbsbench.harness.judge.referee.reading import make_series_selector
from mbsbench.harness.judge.referee.registers import FIELD, PAPER, PLACES
from mbsbench.harness.results.envelopes import compute_envelope
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import make_record, make_series, parse_specs

REGISTERS = {place: read_register(place.path) for place in PLACES}
TESTS = {(t.metric, repr(t.arguments)): t for r in REGISTERS.values() for c in r.claims for t in c.tests}
KNOWN = {name for t in TESTS.values() for name in list_series_read(t.metric, t.arguments)}
RECORD = make_record(steps=400)


def made():
    t = np.linspace(0.0, 10.0, 401)
    random = np.random.default_rng(2)
    return make_series(t, **{name: random.normal(size=401) for name in (*KNOWN, "energy", "unread") if name != "dt"})


@pytest.mark.parametrize("test", [pytest.param(t, id=f"{k} {t.metric}") for k, t in enumerate(TESTS.values())])
def test_a_measure_of_the_register_reads_what_it_says(test):
    """With envelopes of all other series the number has the same bits; one that reads more would be refused."""
    whole = made()
    kept = {"t", "dt", *list_series_read(test.metric, test.arguments)}
    left = {k: compute_envelope(whole["t"], a) for k, a in whole.arrays.items() if k not in kept}
    brief = type(whole)({k: a for k, a in whole.arrays.items() if k in kept}, (), (), (), {}, {}, envelopes=left)
    if MEASURES[test.metric].of_problem:
        pytest.skip("a number of the problem, which no series has")
    numbers = [
        evaluate(test.metric, RECORD, s, test.arguments, *((RECORD, s) if MEASURES[test.metric].of_pair else ()))
        for s in (whole, brief)
    ]
    assert_same(*numbers, equal_nan=True)


def test_a_run_keeps_what_its_claims_and_its_drift_read():
    """A printed run of the paper, a long run, and a ladder that nothing is judged by."""
    text = '[[runs]]\nproblem = "{}"\nparameters = {{ t_end = {} }}\nsolver = "rattle"\ndt = 0.01\nlabel = "{}"'
    long, short = parse_specs(text.format("heavy_top", 100.0, "")) + parse_specs(text.format("heavy_top", 1.0, ""))
    read = make_series_selector(REGISTERS[PAPER], [])
    assert read(long) == {"energy_error", "period_marks"} and read(short) == set()
    kept = set()
    for place, register in REGISTERS.items():
        tried = list_tried_runs(place)
        read = make_series_selector(register, tried)
        found = [read(s) for s in tried]
        kept.update(*found)
        assert place is FIELD or sum(map(bool, found)) > 0.5 * len(tried)
    assert kept >= KNOWN
