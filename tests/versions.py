"""Try the oldest and the newest versions on PyPI that pyproject.toml allows: ``make test-versions``.

Each has an environment below ``.venv/versions``, made anew, in which pip resolves all direct dependencies together: in
``oldest`` each is the first release that its requirement allows, in ``newest`` pip chooses. The tests named in the
call, those of private interfaces and a short run by each solver of the core follow. A table of the versions and of what
broke ends it; the exit code is 1 if anything did.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
import venv
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from mbsbench.harness.base.private_interfaces import KNOWN
from mbsbench.harness.results.records import parse_record_json

ROOT = Path(__file__).resolve().parents[1]
PLACE = ROOT / ".venv" / "versions"
CHECKERS = {"ruff", "mypy", "import-linter", "pandas-stubs", "scipy-stubs"}  # of the extra `dev`; no test imports them
PIP = ("-m", "pip", "--disable-pip-version-check")
PYTEST = ("-m", "pytest", "-q", "--tb=no", "-p", "no:cacheprovider", "--benchmark-disable", "-m", "not slow")
# this one asks for an edit where a version is unknown, and finds no fault: the table marks such versions
PYTEST += ("-k", "not test_the_installed_version_is_known", "tests/harness/base/test_private_interfaces.py")
SUITE = 'name = "versions"\n[[runs]]\nproblem = "spherical_pendulum"\nparameters = {{ t_end = 0.1 }}\nsolver = {}\n'
Done = subprocess.CompletedProcess[str]


class Allowed(NamedTuple):
    """A direct dependency, with the oldest and the newest version on PyPI that its requirement allows."""

    requirement: Requirement
    oldest: str
    newest: str


class Tried(NamedTuple):
    """An environment: installed versions by name, and what broke in it."""

    versions: dict[str, str]
    broken: list[str]


def read_requirements(project: dict[str, Any]) -> list[Requirement]:
    """Return what the package and its tests need on this machine."""
    found = map(Requirement, [*project["dependencies"], *project["optional-dependencies"]["dev"]])
    return [r for r in found if r.name not in CHECKERS and (r.marker is None or r.marker.evaluate())]


def find_allowed(requirement: Requirement) -> Allowed:
    """Ask PyPI for the versions of a dependency that this Python can install; return the ends of those allowed."""
    said = _run(sys.executable, *PIP, "index", "versions", requirement.name)
    listed = re.search(r"^Available versions: (.+)$", said.stdout, re.MULTILINE)  # the newest first
    allowed = [v for v in (listed[1].split(", ") if listed else ()) if requirement.specifier.contains(v)]
    if not allowed:
        sys.exit(f"error: expected a version of {requirement} for this Python on PyPI (got none)\n{said.stderr}")
    return Allowed(requirement, allowed[-1], allowed[0])


def try_environment(place: Path, wanted: Sequence[str], tests: Sequence[str]) -> Tried:
    """Make an environment of the requirements ``wanted`` and this package; run the tests and the solvers there."""
    venv.create(place, with_pip=True)
    python = str(place / "bin" / "python")
    for words in (wanted, ("--no-deps", "--no-build-isolation", "--editable", str(ROOT))):
        done = _run(python, *PIP, "install", "--no-compile", "--progress-bar", "off", *words)
        if done.returncode:
            said = re.findall(r"^(?:ERROR: |    )(\S.+)", done.stdout + done.stderr, re.MULTILINE)
            return Tried({}, [f"pip: {line}" for line in said or [f"ended with {done.returncode}"]])
    listed = json.loads(_run(python, *PIP, "list", "--format", "json").stdout)
    versions = {canonicalize_name(p["name"]): p["version"] for p in listed}
    return Tried(versions, [*list_failed_tests(_run(python, *PYTEST, *tests)), *run_solvers(place)])


def list_failed_tests(done: Done) -> list[str]:
    """Return the tests that failed, or how pytest ended if it names none."""
    failed = re.findall(r"^(?:FAILED|ERROR) (.+)", done.stdout, re.MULTILINE)
    ended = f"pytest ended with {done.returncode}: {(done.stdout + done.stderr)[-300:]}"
    return failed or ([ended] if done.returncode else [])


def run_solvers(place: Path) -> list[str]:
    """Solve a short run by each solver of the core; return those without success."""
    solvers = sorted(p.stem for p in (ROOT / "solvers").glob("*.py") if p.stem != "__init__")
    (place / "versions.toml").write_text(SUITE.format(json.dumps(solvers)), encoding="utf-8")
    done = _run(f"{place}/bin/mbsbench", "run", f"{place}/versions.toml", "--out", f"{place}/results")
    records = [
        parse_record_json(json.loads(p.read_text(encoding="utf-8"))["record"])
        for p in (place / "results" / "runs").glob("*.json")
    ]
    ended = {r.solver: (r.status, r.message) for r in records}
    pairs = ((s, ended.get(s, ("no record", done.stderr[-300:]))) for s in solvers)
    return [f"{s}: {status} {message}" for s, (status, message) in pairs if status != "success"]


def format_table(allowed: Sequence[Allowed], tried: dict[str, Tried]) -> str:
    """Return a line for each dependency, with its version in each environment, then what broke in each."""
    lines = [f"{'requirement':36}" + "".join(f"{name:28}" for name in tried)]
    for a in allowed:
        name, line = canonicalize_name(a.requirement.name), f"{a.requirement.name}{a.requirement.specifier}".ljust(36)
        for place, one in tried.items():
            version, end = one.versions.get(name, "-"), getattr(a, place)
            held = "" if version in ("-", end) else f", PyPI has {end}"
            line += f"{version}{held}{' *' if not version.startswith(KNOWN.get(name, '')) else ''}".ljust(28)
        lines.append(line.rstrip())
    lines.append("* by its public ways: harness/base/private_interfaces.py knows another version")
    for place, one in tried.items():
        lines += [f"{place}: {len(one.broken) or 'nothing'} broke", *(f"    {line}" for line in one.broken)]
    return "\n".join(lines)


def main(tests: Sequence[str]) -> int:
    """Try both environments and print the table; return 1 if anything broke."""
    began = time.monotonic()
    shutil.rmtree(PLACE, ignore_errors=True)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    with ThreadPoolExecutor() as pool:
        allowed = list(pool.map(find_allowed, read_requirements(project)))
    wanted = {
        "oldest": [f"{a.requirement.name}=={a.oldest}" for a in allowed],
        "newest": [f"{a.requirement.name}{a.requirement.specifier}" for a in allowed],
    }
    tried = {}
    for name, words in wanted.items():
        sys.stderr.write(f"{time.monotonic() - began:.0f} s: {name} versions\n")
        tried[name] = try_environment(PLACE / name, words, tests)
        sys.stderr.write("".join(f"    {line}\n" for line in tried[name].broken))
    sys.stdout.write(f"{format_table(allowed, tried)}\n{time.monotonic() - began:.0f} s\n")
    return 1 if any(one.broken for one in tried.values()) else 0


def _run(*words: str) -> Done:
    """Run a command in the checkout; its caches are of these environments alone, so that all is compiled anew."""
    env = os.environ | {"MBSBENCH_CACHE": str(PLACE / "cache")}
    return subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
