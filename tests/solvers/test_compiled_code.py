"""Compiled functions of bundles: what they raise, what they are given, what a kept mechanism is named by."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from mbsbench.solvers.formulations.compiled import entries, numba_code
from mbsbench.solvers.formulations.compiled.entries import Bound
from mbsbench.solvers.formulations.generated import code


class Pair(NamedTuple):
    """One number in, one out."""

    x: Any
    y: Any


def take_root(p: Any) -> None:
    """y = sqrt(x), not of a negative number."""
    if p.x[0] < 0.0:
        raise ValueError("negative")
    p.y[0] = np.sqrt(p.x[0])


def test_what_compiled_code_raises_reaches_its_caller():
    """Else it would go on with what was there before."""
    pair = Pair(np.array([4.0]), np.zeros(1))
    bound = Bound(take_root, pair)
    bound()
    assert pair.y[0] == 2.0
    pair.x[0] = -1.0
    with pytest.raises(ArithmeticError, match="take_root"):
        bound()
    pair.x[0] = 9.0
    bound()
    assert pair.y[0] == 3.0


def test_another_version_of_numba_compiles_the_same(monkeypatch, tmp_path):
    """Its private methods stay as they are."""
    monkeypatch.setattr(code, "FOLDER", tmp_path)
    monkeypatch.setattr(entries, "_CODES", {})
    monkeypatch.setattr(numba_code.numba, "__version__", "9.0.0")
    own = numba_code.CPUCodeLibrary._optimize_final_module
    seen = []
    monkeypatch.setattr(numba_code, "_close", lambda library: seen.append(library))
    pair = Pair(np.array([4.0]), np.zeros(1))
    Bound(take_root, pair)()
    assert pair.y[0] == 2.0 and not seen and numba_code.CPUCodeLibrary._optimize_final_module is own
