"""For all tests: one thread for linear algebra; with SHAPES=1, arrays have the shapes that their annotations say.

The checks triple the time of tests and of what they fork, so `make test-shapes` alone asks for them. In a copy of the
core (`make core`) tests of what it lacks are left out: those that import it, and those marked ``beyond_core``.
"""

import gc
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from jaxtyping import install_import_hook

import mbsbench.tests.shape_checks  # noqa: F401 - the hook looks it up by its name

ROOT = Path(__file__).resolve().parents[1]
SHAPED = ("cli", "harness", "problems", "solvers", "reports")
COMPILED = ("user_forces", "iteration", "tableaux", "methods", "compiled", "passes", "rows")  # numba takes no wrapper
LOOKS = ("code_meter",)  # it looks at who calls it, which a wrapper would be
EXTENDED = ("exact",)  # jaxtyping has no dtype of 64 bits of mantissa
if os.environ.get("SHAPES") == "1":
    install_import_hook(
        [
            ".".join(("mbsbench", *path.relative_to(ROOT).with_suffix("").parts))
            for folder in SHAPED
            for path in (ROOT / folder).rglob("*.py")
            if path.stem not in (*COMPILED, *LOOKS) and path.parent.name not in (*COMPILED, *EXTENDED)
        ],
        "mbsbench.tests.shape_checks.check",
    )

from mbsbench.harness.base.machine import THREADS  # noqa: E402 - below the hook, which sees what comes later

os.environ.update(THREADS)
if TYPE_CHECKING:
    from mbsbench.tests.kept_supervisor import Keeper

# a copy without all three is one of the core; a tree that has lost one of them fails
CORE_ALONE = not any(
    (ROOT / room / "__init__.py").exists() for room in ("harness/lab", "harness/formats", "solvers/engines")
)
BEYOND = re.compile(  # an import of what was deleted
    r"^\s*from (mbsbench|tests|\.+)[\w.]*\.?(lab|formats|engines)\b|from mbsbench import .*\bkit\b|mbsbench\.kit"
    r"|^from [\w.]*\.(bundles|test_check_bundle) import",  # helpers that do
    re.MULTILINE,
)


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out a file of tests that imports a room which a copy of the core lacks."""
    if CORE_ALONE and collection_path.suffix == ".py" and BEYOND.search(collection_path.read_text(encoding="utf-8")):
        return True
    return None


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--cases``: which cases of tests marked ``sampled`` run."""
    parser.addoption(
        "--cases",
        choices=("all", "few", "rest"),
        default="all",
        help="all; few: n cases of tests marked sampled(n), and all other tests; rest: what few leaves out",
    )


@pytest.hookimpl(trylast=True)  # after -m and -k, so that cases are sampled from those that would run
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests of rooms which a copy of the core lacks, and cases that ``--cases`` does not ask for."""
    left_out = {item for item in items if CORE_ALONE and item.get_closest_marker("beyond_core")}
    cases = config.getoption("cases")
    if cases != "all":
        left_out |= set(items) - sample_cases(items) if cases == "few" else sample_cases(items)
    if left_out:
        config.hook.pytest_deselected(items=list(left_out))
        items[:] = [item for item in items if item not in left_out]


def sample_cases(items: list[pytest.Item]) -> set[pytest.Item]:
    """Return the cases of ``make test``: n cases at even distances of tests marked ``sampled(n)``, and all others."""
    by_test: dict[str, list[pytest.Item]] = {}
    for item in items:
        by_test.setdefault(item.nodeid.partition("[")[0], []).append(item)
    chosen: set[pytest.Item] = set()
    for of_test in by_test.values():
        marker = of_test[0].get_closest_marker("sampled")
        n = len(of_test) if marker is None else min(marker.args[0], len(of_test))
        chosen.update(of_test[k * len(of_test) // n] for k in range(n))
    return chosen


def pytest_collection_finish() -> None:
    """Exempt what all tests share from garbage collection: it takes half a second, and a fork copies what it marks."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def supervisors() -> "Iterator[Keeper]":
    """All suites of a session are run by one supervisor after another, but for those that ask for their own."""
    from mbsbench.harness.run import pool
    from mbsbench.tests.kept_supervisor import Keeper

    keeper = Keeper()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pool, "Supervised", keeper.take)
        yield keeper
    keeper.end()


@pytest.fixture(scope="module")
def own_supervisor(supervisors: "Keeper") -> Iterator[None]:
    """Each suite has a supervisor of its own, as ``mbsbench run`` has, and none is left from before."""
    from mbsbench.harness.run import pool, protocol

    supervisors.end()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pool, "Supervised", protocol.Supervised)
        yield
