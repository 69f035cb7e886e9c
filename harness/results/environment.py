"""The origin of a result: code, commit, packages, machine, threads."""

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

from .. import machine

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "requirements.lock"
BLAS = ("internal_api", "version", "num_threads", "architecture")  # of a library, as threadpoolctl names them
COMMIT = re.compile(r"[0-9a-f]{7,64}")  # its digest, or the first digits
SHAPING = ("harness", "problems", "solvers")  # folders with code that a run's numbers come from
PLATFORM = (  # numbers may depend on these; on the processor only where nothing is pinned
    "python", "implementation", "packages", "cpu", "machine", "blas", "simd", "llvm", "libc", "threads",
)  # fmt: skip


@cache
def code_digest(plugins: tuple[str, ...] = ()) -> str:
    """Digest of all code that numbers of runs come from."""
    from .codes import package_sources  # here: the command line starts with this module

    return package_sources().digest_all(plugins)


@cache
def commit() -> str:
    """Commit of the checkout, with ``+dirty`` when it has changes; empty outside a checkout."""
    head = _git("rev-parse", "HEAD")
    return head + ("+dirty" if head and _git("status", "--porcelain") else "")


def stamp(folder: str, suite: str, jobs: int, plugins: Iterable[str]) -> dict[str, Any]:
    """The content of ``environment.json``."""
    import psutil

    names = sorted({*_read_lock(), "numpy", "scipy"})
    return {
        "schema": 1, "results_folder": folder, "suite": suite, "started": now(),
        "commit": commit().removesuffix("+dirty"), "dirty": commit().endswith("+dirty"),
        "code": code_digest(tuple(plugins)), "lock_sha256": hashlib.sha256(_content(LOCK)).hexdigest(),
        "python": platform.python_version(), "implementation": platform.python_implementation(),
        "executable": sys.executable, "packages": {name: v for name in names if (v := _version(name))},
        "system": f"{platform.system()} {platform.release()}", "machine": platform.machine(),
        "cpu": machine.cpu_model(), "cores": os.cpu_count(), "memory_MB": int(psutil.virtual_memory().total // 2**20),
        "blas": [{k: b.get(k) for k in BLAS} for b in _blas()],
        **machine.describe(), "threads": dict(machine.THREADS), "jobs": jobs, "plugins": list(plugins),
    }  # fmt: skip


def identity(stamp: Mapping[str, Any]) -> str:
    """Digest of the machine, packages and threads of a stamp."""
    return _digest(stamp, PLATFORM)


def arithmetic(stamp: Mapping[str, Any]) -> str:
    """Digest of what the last digits of numbers depend on: where all is pinned, the processor is no part of it."""
    return _digest(stamp, [key for key in PLATFORM if key != "cpu" or not stamp.get("pinned")])


def _digest(stamp: Mapping[str, Any], keys: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(text_of(stamp.get(key)) for key in keys).encode()).hexdigest()[:12]


def text_of(value: Any) -> str:
    """A value to compare; a list is of things as found in memory, in the order of imports, which means nothing."""
    rows = sorted(json.dumps(x, sort_keys=True) for x in value) if isinstance(value, list) else value
    return json.dumps(rows, sort_keys=True)


def list_changed_files(before: str, after: str) -> list[str]:
    """List the files that shape results and differ between two commits; empty if one is not known in this checkout."""
    if not all(map(COMMIT.fullmatch, (before, after))):  # of a stamp, which may say anything: no option of git
        return []
    return _git("diff", "--name-only", before, after, "--", LOCK.name, *SHAPING).splitlines()


def archive_commit(commit: str) -> bytes:
    """Return the files of a commit of this checkout as a TAR archive; ValueError where it is not known here."""
    call = ("git", "archive", "--format=tar", commit)
    try:
        if COMMIT.fullmatch(commit):
            return subprocess.run(call, cwd=ROOT, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):  # no git, or no such commit
        pass
    raise ValueError(f"commit {commit[:64]!r} of its code is not here: run its suite again")


def now(*, fine: bool = False) -> str:
    """UTC, ISO 8601, to the second or, where the order of two is asked for, to the microsecond."""
    return datetime.datetime.now(datetime.UTC).strftime(f"%Y-%m-%dT%H:%M:%S{'.%f' if fine else ''}Z")


def _content(path: Path) -> bytes:
    return path.read_bytes() if path.is_file() else b""


def _git(*arguments: str) -> str:
    if not (ROOT / ".git").exists():  # installed: a repository around the environment is another project's
        return ""
    try:
        done = subprocess.run(("git", *arguments), cwd=ROOT, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _read_lock() -> list[str]:
    lines = _content(LOCK).decode().splitlines()
    return [line.split("==")[0] for line in lines if "==" in line and not line.startswith((" ", "#"))]


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _blas() -> list[dict[str, Any]]:
    """Linear algebra libraries of NumPy, SciPy and, if installed, SUNDIALS, loaded here; no other package's count."""
    import numpy
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info, threadpool_limits

    with contextlib.suppress(ImportError):  # not to be had on every system
        import sksundae  # noqa: F401
    packages, ours = Path(numpy.__file__).resolve().parents[1], ("numpy", "scipy", "scikit_sundae", "sksundae")
    with threadpool_limits(limits=1):  # as where runs are run, whatever is set in this process
        places = [(library, Path(library["filepath"]).resolve()) for library in threadpool_info()]
    return [b for b, p in places if not p.is_relative_to(packages) or p.relative_to(packages).parts[0].startswith(ours)]


if __name__ == "__main__":  # the environment of a process like those of runs, for one that has loaded NumPy its own way
    sys.stdout.write(json.dumps(stamp("", "", 1, ())))
