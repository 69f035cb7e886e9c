"""Runs of known answer: cells of the catalogue, records and series made up to the number that is to be found."""

import dataclasses
import hashlib

import numpy as np

from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series
from mbsbench.harness.suites.cell import Cell
from mbsbench.harness.suites.suite import parse_suite

HEAD = 'id = "c"\nsection = "5.2"\nfigure = [5]\nquote = "words"\nclaim = "ours"\n'


def cells_of(text: str) -> tuple[Cell, ...]:
    """The cells of a suite written in a test."""
    return parse_suite(text, "test", "test").cells


def record(cell: Cell, **columns) -> RunRecord:
    """A run of ``cell`` that got to its end, unless ``columns`` say otherwise."""
    t_end = float(columns.pop("t_end_s", 10.0))
    given = {
        "cell": hashlib.sha256(cell.settings.encode()).hexdigest()[:16],
        "settings": cell.settings,
        "case": cell.case,
        "problem": cell.problem,
        "solver": cell.solver,
        "status": "success",
        "t_end_s": t_end,
        "t_reached_s": t_end,
        "series": "made up",
    }
    return RunRecord(**{**given, **columns})


def bare(t_end: float = 10.0, **columns) -> RunRecord:
    """A record without a cell, for measures."""
    return RunRecord(**{"t_end_s": t_end, "t_reached_s": t_end, **columns})


def series(t, **arrays) -> Series:
    """Series over ``t``; dt is that of the steps."""
    t = np.asarray(t, dtype=float)
    dt = np.insert(np.diff(t), 0, np.nan)
    return Series({"t": t, "dt": dt, **{k: np.asarray(a, dtype=float) for k, a in arrays.items()}}, (), (), (), {}, {})


def altered(one: Series, **arrays) -> Series:
    """The same with other arrays."""
    return dataclasses.replace(one, arrays={**one.arrays, **arrays})
