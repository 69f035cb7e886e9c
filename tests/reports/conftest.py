"""Run folders made by hand: every kind of ending, hostile texts, series that are whole, empty or not numbers."""

import dataclasses
import json
import os
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mbsbench.harness.base.files import write_text
from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results import store
from mbsbench.harness.results.records import RunRecord, format_reasons
from mbsbench.harness.results.series import Series, write_series
from mbsbench.reports import site
from mbsbench.reports.pages.base import Site
from mbsbench.tests.factories import make_measured_record, make_swing

from .browser import AXE, CHROMIUM, Browser

HOSTILE = '<script>alert("1")</script> & $x_{ \\frac -->'


def pytest_configure(config):
    config.addinivalue_line("markers", "browser: needs Chromium; skipped without one, a failure where CI is set")


def because(name: str) -> str:
    """The column ``wrong_because`` with one reason, whose words begin with ``name``."""
    return format_reasons([Reason(Law.SYMMETRY, 2.0, 1.0, "m", name=name)])


def put(folder: Path, run: RunRecord, motion: Series | None = None, stderr: str = "") -> RunRecord:
    """Store a run as the runner does."""
    store.create_folder(folder)
    if motion is not None:
        name = f"series/{run.run_id}.npz"
        run = dataclasses.replace(run, series=name, series_sha256=write_series(folder / name, motion))
    if stderr:
        run = dataclasses.replace(run, stderr=f"stderr/{run.run_id}.txt")
        write_text(folder / run.stderr, stderr)
    store.write_record(folder, run)
    return run


def every_kind(folder: Path) -> list[RunRecord]:
    """Success, wrong, refused, stopped, killed without a step, numbers that are none, hostile names."""
    nan = float("nan")
    nothing = dict.fromkeys(
        ("t_reached_s", "energy_drift_max_J", "phi_max", "position_error_max_m", "cpu_median_s"), nan
    )
    broken = make_swing()
    broken.arrays["energy_error"].setflags(write=True)
    broken.arrays["energy_error"][100:] = np.nan
    return [
        put(folder, make_measured_record("aa01"), make_swing()),
        put(
            folder, make_measured_record("aa02", dt_s=0.005, position_error_max_m=2.5e-4), make_swing(600, size=2.5e-4)
        ),
        put(
            folder,
            make_measured_record("bb01", "beta", "wrong", wrong_because=because(f"|phi| is large {HOSTILE}")),
            make_swing(size=0.3),
        ),
        put(
            folder,
            make_measured_record("cc01", "gamma", "refused", claimed="refused", message="rank 325 of 400", **nothing),
        ),
        put(
            folder,
            make_measured_record("dd01", "delta", "step_underflow", message=f"stuck {HOSTILE}", t_reached_s=0.7),
            make_swing(90, 0.7),
            stderr=f"[IDA ERROR] {HOSTILE}",
        ),
        put(folder, make_measured_record("ee01", "epsilon", "crashed", signal=11, message="signal 11", **nothing)),
        put(
            folder,
            make_measured_record("ff01", "alpha", "diverged", label="as printed", energy_drift_max_J=float("inf")),
            broken,
        ),
        put(folder, make_measured_record("gg01", HOSTILE, problem=HOSTILE, label=HOSTILE, case=HOSTILE), make_swing()),
        put(
            folder,
            make_measured_record(
                "hh01",
                "beta",
                problem="lonely",
                status="stalled",
                message="the wall limit of 60 s was reached",
                t_reached_s=0.0,
                steps=0,
            ),
            make_swing(1),
        ),
    ]


@pytest.fixture(scope="session")
def built(tmp_path_factory) -> tuple[Path, list[RunRecord], str]:
    """The folder, its records and its page."""
    folder = tmp_path_factory.mktemp("run")
    records = every_kind(folder)
    write_text(
        folder / "environment.json",
        json.dumps(
            {
                "run": "hand-made-1",
                "suite": "hand made",
                "started": "2026-01-01T00:00:00Z",
                "commit": "f00d" * 10,
                "dirty": True,
                "cpu": "a processor",
                "cores": 2,
                "jobs": 1,
                "python": "3.11",
                "packages": {"numpy": "2.4"},
                "blas": [{"internal_api": "openblas", "version": "0.3", "num_threads": 1}],
            }
        ),
    )
    return folder, records, site.build_report(folder).read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def browser():
    """One headless Chromium for all tests of a process."""
    if CHROMIUM is None:
        absent("no Chromium on this machine: `make browser`, or set CHROMIUM")
    with Browser() as running:
        yield running


@pytest.fixture
def axe(browser):
    """Asks axe-core about a page."""
    if not AXE.is_file():
        absent("no axe-core: `make browser`")

    def violations(page: Path) -> list[str]:
        tab = browser.open(page)
        try:
            return tab.violations()
        finally:
            tab.close()

    return violations


def absent(why: str) -> None:
    """A tool that a browser's test needs is missing: a failure where CI is set."""
    pytest.fail(why) if os.environ.get("CI") else pytest.skip(why)


@pytest.fixture
def report(built):
    """The folder of its pages."""
    return built[0] / "report"


@pytest.fixture(scope="session")
def matrices(tmp_path_factory):
    """Four problems, one without a run of beta, under two labels; a variant that must change nothing."""
    folder = tmp_path_factory.mktemp("matrices")
    ends = {"far": ("success", 3e-2, 9.0), "near": ("success", 5e-9, 0.05), "stuck": ("diverged", 1e-12, 0.0)}
    for k, (name, (status, size, cpu)) in enumerate(ends.items()):
        own = {"problem": name, "section": f"Sect. {k}", "position_error_max_m": size, "cpu_median_s": cpu}
        put(
            folder,
            make_measured_record(f"a{k}", "alpha", status, message="lost", **own | {"cpu_median_s": cpu or 0.2}),
            make_swing(size=size),
        )
        put(
            folder, make_measured_record(f"b{k}", "beta", **own | {"position_error_max_m": 1.0 / (k + 1)}), make_swing()
        )
    put(
        folder,
        make_measured_record(
            "a3",
            "alpha",
            "wrong",
            problem="off",
            section="Sect. 3",
            position_error_max_m=1e-5,
            wrong_because=because("far off"),
        ),
        make_swing(),
    )
    for k, name in ((0, "far"), (1, "near"), (3, "off")):
        put(
            folder,
            make_measured_record(
                f"c{k}", problem=name, section=f"Sect. {k}", label="map", dt_s=0.1, position_error_max_m=4.0 - k
            ),
            make_swing(),
        )
    write_text(folder / "environment.json", "{}")
    return site.build_report(folder)


@pytest.fixture(autouse=True)
def closed_tabs(request):
    """A test's tabs end with it, however it ends."""
    yield
    if "browser" in request.fixturenames:
        request.getfixturevalue("browser").close_tabs()


def write_modules(written: Site, modules: Iterable[ModuleType]) -> None:
    """Call page modules as a report does: for each variant first, here in this process."""
    called = tuple(modules)
    for module in (m for m in called if hasattr(m, "write_variant")):
        made = ((v.slug, module.write_variant(written.results, written, v)) for v in written.results.variants)
        written.parts[module.__name__] = dict(made)
    for module in called:
        module.write(written.results, written)
