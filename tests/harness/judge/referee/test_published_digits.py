"""Published numbers are those of this machine, digit for digit, whatever the processor that they were computed on."""

import json
import platform
import sys

import pytest

from mbsbench.harness.base import machine
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.results import store
from mbsbench.harness.results.judgements.files import PUBLISHED
from mbsbench.harness.run.job import Job
from mbsbench.tests.factories import run_here

POINTS = json.loads((PUBLISHED / "work.json").path.read_text(encoding="utf-8"))["points"]
CHEAPEST = {p["solver"]: p for p in sorted(POINTS, key=lambda p: -p["cpu_s"]) if p["status"] == "success"}
LIBC = "2.36"
pytestmark = [
    pytest.mark.published,
    pytest.mark.skipif(sys.version_info >= (3, 12), reason="published with the lock's packages for Python 3.11"),
    pytest.mark.skipif(
        platform.machine() != "x86_64" or platform.libc_ver() != ("glibc", LIBC),
        reason=f"published from x86-64 with glibc {LIBC}, whose sines are not ours",
    ),
    pytest.mark.skipif(bool(machine.find_deviations()), reason="the arithmetic is not pinned"),
]


@pytest.fixture(scope="module")
def specs():
    return {spec.settings_id: spec for spec in load_suite("referee").specs}


@pytest.mark.parametrize("solver", sorted(CHEAPEST))
def test_the_cheapest_published_run_of_a_solver_has_the_same_digits(specs, solver, tmp_path):
    """Drift, constraint norm, error and steps, not within a tolerance: bits are promised on every such processor."""
    published = CHEAPEST[solver]
    record = run_here(Job(specs[published["settings_id"]], store.create_folder(tmp_path)))
    assert (record.steps, record.energy_drift_max_J, record.phi_max) == (
        published["steps"],
        published["energy_drift_J"],
        published["phi_max"],
    )
    errors = (record.position_error_judged_m, record.motion_error_judged_m, record.orientation_error_judged_rad)
    assert published["error"] in errors
