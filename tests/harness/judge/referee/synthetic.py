"""Runs of known answer: runs of the catalogue, records and series made up to the number that is to be found."""

import dataclasses
import hashlib

import numpy as np

from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series

HEAD = 'id = "c"\nsection = "5.2"\nfigure = [5]\nquote = "words"\nclaim = "ours"\n'


def runs_of(text: str) -> tuple[RunSpec, ...]:
    """The runs of a suite written in a test."""
    return parse_suite(text, "test", "test").specs


def record(spec: RunSpec, **columns) -> RunRecord:
    """A run of ``run`` that got to its end, unless ``columns`` say otherwise."""
    t_end = float(columns.pop("t_end_s", 10.0))
    given = {
        "run_id": hashlib.sha256(spec.settings_id.encode()).hexdigest()[:16],
        "settings_id": spec.settings_id,
        "case": spec.case,
        "problem": spec.problem,
        "solver": spec.solver,
        "status": "success",
        "t_end_s": t_end,
        "t_reached_s": t_end,
        "series": "made up",
    }
    return RunRecord(**{**given, **columns})


def bare(t_end: float = 10.0, **columns) -> RunRecord:
    """A record without a run, for measures."""
    return RunRecord(**{"t_end_s": t_end, "t_reached_s": t_end, **columns})


def series(t, **arrays) -> Series:
    """Series over ``t``; dt is that of the steps."""
    t = np.asarray(t, dtype=float)
    dt = np.insert(np.diff(t), 0, np.nan)
    return Series({"t": t, "dt": dt, **{k: np.asarray(a, dtype=float) for k, a in arrays.items()}}, (), (), (), {}, {})


def altered(one: Series, **arrays) -> Series:
    """The same with other arrays."""
    return dataclasses.replace(one, arrays={**one.arrays, **arrays})
