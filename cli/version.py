"""Describe the software and machine that determine numbers and times, for a bug report (``--version``)."""

import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ..harness.base import machine
from ..harness.base.cache import ROOT, list_caches
from ..harness.results import environment
from .parser import UsageError

# packages whose code affects the numbers of runs
PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "casadi", "scikit-sundae")
# engines of `make engines`, installed in the same environment
ENGINES = ("mujoco-core", "exudyn", "pin", "drake", "dartpy")
ADD_ENGINES = "add engines: make engines, or outside a checkout pip install 'mbsbench[engines]'"
VERBOSE = "--verbose"


def describe_version(options: Sequence[str]) -> str:
    """Return lines on versions, commit, machine and arithmetic.

    ``options`` may hold --verbose, which adds the paths of caches and results; any other raises UsageError.
    """
    if unknown := [word for word in options if word != VERBOSE]:
        raise UsageError(f"--version takes {VERBOSE} alone (got {unknown[0]!r})")
    commit = environment.read_commit()
    base, _, changed = commit.partition("+")
    words = f" (commit {base[:12]}{', changed since' if changed else ''})" if commit else ""
    bits = "as on every processor with AVX2" if machine.list_variables() else "of this processor"
    if os.environ.get(machine.NATIVE) == "1":
        bits = f"of this processor ({machine.NATIVE}=1)"
    engines = _list_versions(ENGINES) or f"none; {ADD_ENGINES}"
    rows = {
        "python": f"{platform.python_version()}; {_list_versions(PACKAGES)}",
        "machine": f"{machine.read_cpu_model()}, {os.cpu_count()} cores; {platform.system()} {platform.machine()}, "
        f"{' '.join(platform.libc_ver()).strip() or platform.release()}",
        "bits": bits,
        "engines": engines,
    }
    if VERBOSE in options:
        rows |= {"package": str(ROOT), "results": str(Path("results", "local").absolute())}
        rows |= {f"cache {c.name}": f"{c.folder} ({c.bytes / 1e6:.1f} MB)" for c in list_caches()}
    width = max(map(len, rows))
    return "\n".join([f"mbsbench {version('mbsbench')}{words}", *(f"{k:<{width}}  {v}" for k, v in rows.items()), ""])


def _list_versions(names: Sequence[str]) -> str:
    """Return those of the packages ``names`` that are installed, with versions: ``numpy 2.1.0, scipy 1.14.1``."""
    found = []
    for name in names:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)
