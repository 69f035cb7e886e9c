"""What follows from an exact motion alone is computed once for all runs of a problem, and is the same to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.metrics import stored_loads
from mbsbench.harness.judge.metrics.reactions import compute_exact_loads
from mbsbench.harness.judge.metrics.scales import find_scales
from mbsbench.harness.judge.metrics.stored_loads import find_exact_loads, hold_code
from mbsbench.harness.reference import held, orbit
from mbsbench.harness.reference.computation import find_reference
from mbsbench.harness.reference.held import forget_value, hold_values, peek_value, recall_value
from mbsbench.harness.reference.orbit import NotStoredError, load_or_compute, read_only_stored
from mbsbench.harness.run.kept_series import hold_exact_motion


@pytest.fixture(autouse=True)
def nothing_held(monkeypatch, tmp_path):
    """Hold nothing before and after, and store loads in a folder of the test."""
    monkeypatch.setattr(held, "_held", {})
    return tmp_path


@pytest.fixture
def grid(nothing_held, monkeypatch):
    """A small grid of linkages with its exact states at even times of which only some are compared."""
    problem = registry.make_problem("four_bar_grid", {"t_end": 0.2, "rows": 2, "columns": 2})
    t = np.linspace(0.0, 0.2, 41)
    exact = find_reference(problem).states(t[1::4])
    monkeypatch.setattr(orbit, "FOLDER", nothing_held)
    return problem, t, exact


def list_files(folder):
    """Return all files of loads below a folder."""
    return sorted(folder.rglob("loads-*.bin"))


def test_stored_loads_are_those_computed_to_the_bit(grid, tmp_path, monkeypatch):
    """A second run with the same instants loads what the first computed; one with other instants computes its own."""
    problem, t, exact = grid
    computed = compute_exact_loads(problem.system, exact)
    assert np.any(np.isfinite(computed)) and not list_files(tmp_path)
    hold_values(problem)
    hold_code(problem, "code")
    first = find_exact_loads(problem, t, exact)
    assert len(list_files(tmp_path)) == 1
    monkeypatch.setattr(stored_loads, "compute_exact_loads", lambda *_: pytest.fail("computed again"))
    second = find_exact_loads(problem, t, exact)
    assert first.tobytes() == second.tobytes() == computed.tobytes()
    with pytest.raises(pytest.fail.Exception, match="computed again"):
        find_exact_loads(problem, t, replace(exact, r=exact.r + 1e-15))


@pytest.mark.parametrize("change", ["code", "uneven", "not held", "damaged"])
def test_loads_are_computed_where_a_file_may_not_serve(grid, tmp_path, monkeypatch, change):
    """Other code, steps of another length, a problem that the parent does not hold, a file with one flipped bit."""
    problem, t, exact = grid
    hold_values(problem)
    hold_code(problem, "code")
    find_exact_loads(problem, t, exact)
    if change == "code":
        forget_value(problem, stored_loads.CODE)
        hold_code(problem, "other code")
    if change == "uneven":
        t = t**2
    if change == "not held":
        problem = replace(problem)
    if change == "damaged":
        (file,) = list_files(tmp_path)
        content = bytearray(file.read_bytes())
        content[-1] ^= 1
        file.write_bytes(content)
    told = []
    monkeypatch.setattr(stored_loads, "compute_exact_loads", lambda *a: told.append(1) or compute_exact_loads(*a))
    again = find_exact_loads(problem, t, exact)
    assert told and again.tobytes() == compute_exact_loads(problem.system, exact).tobytes()


def test_values_belong_to_one_object():
    """A problem of equal content computes anew: another reference may have been put into it."""
    problem = registry.make_problem("heavy_top")
    calls = []
    ask = lambda p: recall_value(p, "key", lambda: calls.append(1) or len(calls))  # noqa: E731
    assert [ask(problem), ask(problem)] == [1, 2] and peek_value(problem, "key") is None
    hold_values(problem)
    assert [ask(problem), ask(problem), ask(replace(problem))] == [3, 3, 4] and peek_value(problem, "key") == 3
    forget_value(problem, "key")
    assert ask(problem) == 5


def test_a_held_motion_has_the_scales_of_one_that_is_not():
    """To the bit; the reference itself is not held."""
    problem, other = (registry.make_problem("spherical_pendulum", {"omega_z": 0.1}) for _ in range(2))
    hold_exact_motion(problem, "code", brief=True)
    assert peek_value(problem, "reference") is None and peek_value(problem, stored_loads.CODE) == "code"
    assert find_scales(problem, find_reference(problem)) == find_scales(other, find_reference(other))


def test_a_process_that_must_not_compute_says_that_nothing_is_stored(tmp_path, monkeypatch):
    """The parent of runs reads an orbit, and leaves one that is not on disk to its runs."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    compute = lambda: pytest.fail("computed")  # noqa: E731
    with read_only_stored(), pytest.raises(NotStoredError):
        load_or_compute("0" * 64, compute)
    with read_only_stored(), pytest.raises(NotStoredError):
        load_or_compute(None, compute)
    assert load_or_compute("0" * 64, lambda: None) is None
    with read_only_stored():
        assert load_or_compute("0" * 64, compute) is None
