"""The code, machine and versions of results in a line; ``templates/provenance.html`` says it in full."""

from .results import Results

UNKNOWN = "not recorded"
STAMPED = ("numpy", "scipy")  # packages of the line


def stamp(results: Results) -> str:
    """Commit, dirty flag, versions, machine."""
    e, versions = results.environment, dict(packages(results))
    known = [f"Python {e.get('python') or UNKNOWN}", *(f"{k} {versions[k]}" for k in STAMPED if k in versions)]
    commit = str(e.get("commit") or UNKNOWN)[:12] + (" with uncommitted changes (dirty)" if e.get("dirty") else "")
    return f"Commit {commit}; {', '.join(known)}; {e.get('cpu') or UNKNOWN}, {e.get('cores', '?')} cores."


def packages(results: Results) -> list[tuple[str, str]]:
    """Every recorded package."""
    found = results.environment.get("packages")
    return sorted((str(k), str(v)) for k, v in found.items()) if isinstance(found, dict) else []
