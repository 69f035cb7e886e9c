"""The code, machine and versions of a run, for the head of a page."""

from collections.abc import Mapping, Sequence
from typing import Any

from .results import Results, Run

UNKNOWN = "not recorded"
ASKED = {"dt_s": "dt {} s", "rtol": "rtol {}", "max_step_s": "max step {} s"}
LIMITS = {"cpu_limit_s": "{} s CPU time", "memory_limit_MB": "{} MB"}
STAMPED = ("numpy", "scipy")  # packages of the short form


def facts(results: Results) -> list[tuple[str, str]]:
    """Name and value, those a reader checks first at the top."""
    e = results.environment

    def recorded(key: str) -> str:
        return str(e.get(key) or UNKNOWN)

    def of_runs(column: str) -> str:
        return ", ".join(sorted({getattr(c.record, column) for c in results.runs} - {""})) or UNKNOWN

    return [
        ("Suite", str(e.get("suite") or of_runs("suite"))),
        ("Results", str(e.get("results_folder") or results.folder.name)), ("Started", recorded("started")),
        ("Commit", _commit(e)), ("Code digest", str(e.get("code") or of_runs("code"))),
        ("Steps and tolerances", _values(results.runs, ASKED, "; ", largest_first=True)),
        ("Limits per run", _values(results.runs, LIMITS, ", ")),
        ("Machine", f"{_machine(e)}, {e.get('system', '')} {e.get('machine', '')}"),
        ("Parallel processes", recorded("jobs")), ("BLAS", _blas(e.get("blas"))),
        ("Python", recorded("python")), ("Lock file", recorded("lock_sha256")[:16]),
        ("Plugins", ", ".join(results.plugins) or "none"),
    ]  # fmt: skip


def stamp(results: Results) -> str:
    """The same in a line: commit, dirty flag, versions, machine."""
    e = results.environment
    versions = dict(packages(results))
    known = [f"Python {e.get('python') or UNKNOWN}", *(f"{k} {versions[k]}" for k in STAMPED if k in versions)]
    return f"Commit {_commit(e, 12)}; {', '.join(known)}; {_machine(e)}."


def _commit(e: Mapping[str, Any], digits: int | None = None) -> str:
    return str(e.get("commit") or UNKNOWN)[:digits] + (" with uncommitted changes (dirty)" if e.get("dirty") else "")


def _machine(e: Mapping[str, Any]) -> str:
    return f"{e.get('cpu') or UNKNOWN}, {e.get('cores', '?')} cores"


def packages(results: Results) -> list[tuple[str, str]]:
    """Every recorded package."""
    found = results.environment.get("packages")
    return sorted((str(k), str(v)) for k, v in found.items()) if isinstance(found, dict) else []


def _values(runs: Sequence[Run], columns: Mapping[str, str], link: str, *, largest_first: bool = False) -> str:
    """All values of ``columns``, each column with its words."""
    found = {k: {v for c in runs if (v := getattr(c.record, k)) == v} for k in columns}
    values = {k: ", ".join(f"{v:g}" for v in sorted(own, reverse=largest_first)) for k, own in found.items() if own}
    words = [columns[k].format(v) for k, v in values.items()]
    return link.join(words) or UNKNOWN


def _blas(given: Any) -> str:
    known = [b for b in given if isinstance(b, dict)] if isinstance(given, list) else []
    names = dict.fromkeys(" ".join(str(b[k]) for k in ("internal_api", "version") if b.get(k)) for b in known)
    threads = sorted({str(b.get("num_threads")) for b in known})
    return f"{', '.join(names)}: {' or '.join(threads)} thread(s)" if known else UNKNOWN
