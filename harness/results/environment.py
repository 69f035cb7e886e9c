"""Record the origin of a result: code, commit, packages, machine, threads."""

import contextlib
import datetime
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ..base import machine

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "locks" / "requirements.lock"
BLAS = ("internal_api", "version", "num_threads", "architecture")  # facts about a library, named as in threadpoolctl
COMMIT = re.compile(r"[0-9a-f]{7,64}")  # a digest, or its first digits
SHAPING = ("harness", "problems", "solvers")  # folders with code that shapes a run's numbers
PLATFORM = (  # keys on which numbers may depend; on the processor only if nothing is pinned
    "python",
    "implementation",
    "packages",
    "cpu",
    "machine",
    "blas",
    "simd",
    "llvm",
    "libc",
    "threads",
)


@cache
def read_commit() -> str:
    """Return the commit of the checkout, with ``+dirty`` if it has changes; empty outside a checkout."""
    head = _run_git("rev-parse", "HEAD")
    return head + ("+dirty" if head and _run_git("status", "--porcelain") else "")


def describe_environment(folder: str, suite: str, jobs: int, plugins: Iterable[str], code: str) -> dict[str, Any]:
    """Return the content of ``environment.json``, the stamp of a results folder: code, packages, machine, threads.

    ``folder`` is the folder's name, ``suite`` that of its suite, ``jobs`` the number of runs in parallel, ``code`` the
    digest of all code that shapes the numbers of its runs.
    """
    import psutil

    names = sorted({*_read_lock(), "numpy", "scipy"})
    return {
        "schema": 1,
        "results_folder": folder,
        "suite": suite,
        "started": read_utc_time(),
        "commit": read_commit().removesuffix("+dirty"),
        "dirty": read_commit().endswith("+dirty"),
        "code": code,
        "lock_sha256": hashlib.sha256(_read_content(LOCK)).hexdigest(),
        "python": platform.python_version(),
        "implementation": platform.python_implementation(),
        "executable": sys.executable,
        "packages": {name: v for name in names if (v := _find_version(name))},
        "system": f"{platform.system()} {platform.release()}",
        "machine": platform.machine(),
        "cpu": machine.read_cpu_model(),
        "cores": os.cpu_count(),
        "memory_MB": int(psutil.virtual_memory().total // 2**20),
        "blas": [{k: b.get(k) for k in BLAS} for b in _list_blas()],
        **machine.describe_machine(),
        "threads": dict(machine.THREADS),
        "jobs": jobs,
        "plugins": list(plugins),
    }


def digest_environment(stamp: Mapping[str, Any]) -> str:
    """Return the digest of a stamp's machine, packages and threads, by which a run's record names its environment."""
    return _digest(stamp, PLATFORM)


def digest_arithmetic(stamp: Mapping[str, Any]) -> str:
    """Return the digest of everything in a stamp that may affect the last digits of numbers.

    The processor is left out if the kernels of libraries and the target of the compiler are pinned.
    """
    return _digest(stamp, [key for key in PLATFORM if key != "cpu" or not stamp.get("pinned")])


def _digest(stamp: Mapping[str, Any], keys: Iterable[str]) -> str:
    """Return the first 12 hexadecimal digits of the sha256 of these keys of a stamp."""
    return hashlib.sha256("\n".join(format_setting(stamp.get(key)) for key in keys).encode()).hexdigest()[:12]


def format_setting(value: Any) -> str:
    """Return a value of a stamp as JSON text for comparison; lists, whose order is that of imports, are sorted."""
    rows = sorted(json.dumps(x, sort_keys=True) for x in value) if isinstance(value, list) else value
    return json.dumps(rows, sort_keys=True)


def list_changed_files(before: str, after: str) -> list[str]:
    """List the files that shape results and differ between two commits; empty if a commit is unknown here."""
    if not all(map(COMMIT.fullmatch, (before, after))):  # a stamp is untrusted: its text must not be an option of git
        return []
    return _run_git("diff", "--name-only", before, after, "--", str(LOCK.relative_to(ROOT)), *SHAPING).splitlines()


def archive_commit(commit: str) -> bytes:
    """Return the files of a commit of this checkout as a TAR archive; raise ValueError if it is unknown here."""
    call = ("git", "archive", "--format=tar", commit)
    try:
        if COMMIT.fullmatch(commit):
            return subprocess.run(call, cwd=ROOT, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):  # no git, or no such commit
        pass
    raise ValueError(f"commit {commit[:64]!r} of its code is not in this repository: run its suite again")


def read_utc_time(*, fine: bool = False) -> str:
    """Return the UTC time in ISO 8601, to the second or, if ``fine``, to the microsecond."""
    return datetime.datetime.now(datetime.UTC).strftime(f"%Y-%m-%dT%H:%M:%S{'.%f' if fine else ''}Z")


def _read_content(path: Path) -> bytes:
    """Return the content of a file; empty if there is no such file."""
    return path.read_bytes() if path.is_file() else b""


def _run_git(*arguments: str) -> str:
    """Return the output of a git command about this checkout; empty outside a checkout or if it fails."""
    if not (ROOT / ".git").exists():  # if installed, a repository around the environment is another project's
        return ""
    try:
        done = subprocess.run(("git", *arguments), cwd=ROOT, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _read_lock() -> list[str]:
    """Return the names of the locked packages."""
    lines = _read_content(LOCK).decode().splitlines()
    return [line.split("==")[0] for line in lines if "==" in line and not line.startswith((" ", "#"))]


def _find_version(name: str) -> str:
    """Return the version of an installed package; empty if it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _list_blas() -> list[dict[str, Any]]:
    """Return the facts of threadpoolctl about the linear algebra libraries of NumPy, SciPy and SUNDIALS.

    Those of other packages are left out; libraries of the system, which lie outside the packages, are included. All are
    loaded by this call.
    """
    import numpy
    import scipy.linalg  # noqa: F401  its BLAS is listed once loaded
    from threadpoolctl import threadpool_info, threadpool_limits

    with contextlib.suppress(ImportError):  # not available on every system
        import sksundae  # noqa: F401  as scipy.linalg
    packages, ours = Path(numpy.__file__).resolve().parents[1], ("numpy", "scipy", "scikit_sundae", "sksundae")
    with threadpool_limits(limits=1):  # as in processes of runs, whatever is set in this one
        places = [(library, Path(library["filepath"]).resolve()) for library in threadpool_info()]
    return [b for b, p in places if not p.is_relative_to(packages) or p.relative_to(packages).parts[0].startswith(ours)]
