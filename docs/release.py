"""Check that nothing lags behind the version in pyproject.toml, and make its wheel: ``make release``.

Each check has a line; one that fails says what to do. When all pass, the wheel is in ``results/local/release`` and the
commands that tag and publish are printed: nothing is tagged or pushed here. docs/releasing.md has what no program can
check.
"""

import mbsbench  # noqa: F401  before NumPy: it pins the arithmetic

# isort: split
import ast
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import draw_pictures  # type: ignore[import-not-found]  # beside this file
from packaging.requirements import Requirement
from packaging.version import Version

from mbsbench.harness.judge.referee import judge
from mbsbench.harness.judge.referee.registers import PLACES
from mbsbench.harness.lab.bundle.contents import VERSION as BUNDLE
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.judgements.claims import SCHEMA as CLAIMS
from mbsbench.harness.results.judgements.files import PUBLISHED
from mbsbench.harness.results.records import SCHEMA as RECORDS
from mbsbench.harness.results.series import BRIEF, PLAIN

WHEELS = ROOT / "results" / "local" / "release"
SECTION = re.compile(r"^## (.+)$", re.MULTILINE)
PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([\w.]+)", re.MULTILINE)
NUMBERS = {"record": (RECORDS,), "series": (PLAIN, BRIEF), "claims.json": (CLAIMS,), "bundle": (BUNDLE,)}
LOCKS = {"dev": "locks/requirements.lock"}
LOCKS |= {extra: f"locks/requirements-{extra}.lock" for extra in ("engines", "formats", "docs", "cluster")}
REMEDY = "see 'When published results are stale' in CONTRIBUTING.md"
Check = Callable[[Path], Iterator[str]]


def read_version(root: Path) -> str:
    """Return the version in pyproject.toml."""
    return str(_read_project(root)["version"])


def check_versions(root: Path) -> Iterator[str]:
    """Yield each place that does not state the version: citation, newest section of the changelog.

    A tag of that version which exists already is a fault, too.
    """
    version = read_version(root)
    found = re.search(r"^version: *(\S+)", (root / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    if found is None or found[1].strip("\"'") != version:
        yield f"CITATION.cff: expected version: {version} (got {found[1] if found else 'none'})"
    sections = SECTION.findall((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    dated = [re.fullmatch(rf"{re.escape(version)} \(\d{{4}}-\d\d-\d\d\)", s) is not None for s in sections]
    if any(dated[1:]):
        where = "raise version in pyproject.toml and CITATION.cff"
        yield f"CHANGELOG.md: '## {sections[0]}' stands above {version}: {where}"
    elif not any(dated):
        first = sections[0] if sections else "none"
        yield f"CHANGELOG.md: expected '## {version} (YYYY-MM-DD)' as its first section (got '## {first}')"
    if _git(root, "tag", "--list", f"v{version}"):
        yield f"tag v{version} exists: raise version in pyproject.toml and CITATION.cff"


def check_tree(root: Path) -> Iterator[str]:
    """Yield a line if files are not committed."""
    if changed := _git(root, "status", "--porcelain").splitlines():
        yield f"{len(changed)} files are not committed, {changed[0][3:]} first: commit or remove them"


def check_published(root: Path) -> Iterator[str]:
    """Yield the published verdicts and pictures that are of other code than this."""
    for place in PLACES:
        if words := judge.describe_outdated(PUBLISHED, place):
            yield f"{words}; {REMEDY}"
    for name in ("costs", "chain"):
        text = (root / "docs" / "images" / f"{name}.svg").read_text(encoding="utf-8")
        if not {*re.findall(r"code of its runs: (\w+)", text)} & {*draw_pictures.list_present_digests()}:
            yield f"docs/images/{name}.svg is drawn from runs of other code: make engines bench pictures; {REMEDY}"


def check_locks(root: Path) -> Iterator[str]:
    """Yield requirements of pyproject.toml that its lock files do not pin, or pin to another version."""
    project = _read_project(root)
    wanted = {"locks/requirements.lock": list(project["dependencies"])}
    for extra, lock in LOCKS.items():
        wanted.setdefault(lock, []).extend(project["optional-dependencies"][extra])
    for lock, requirements in wanted.items():
        pins = {k.lower().replace("_", "-"): v for k, v in PIN.findall((root / lock).read_text(encoding="utf-8"))}
        for one in map(Requirement, requirements):
            pinned = pins.get(one.name.lower().replace("_", "-"))
            if pinned is None or not one.specifier.contains(Version(pinned)):
                yield f"{lock}: expected {one.name}{one.specifier} (got {pinned or 'none'}): write the lock anew"


def check_formats(root: Path) -> Iterator[str]:
    """Yield formats whose number in docs/releasing.md is not that of the code."""
    page = (root / "docs" / "releasing.md").read_text(encoding="utf-8")
    for name, numbers in NUMBERS.items():
        row = re.search(rf"^\| [^|]*`?{re.escape(name)}`?[^|]*\| ([\d, ]+) \|", page, re.MULTILINE)
        stated = tuple(int(n) for n in re.findall(r"\d+", row[1])) if row else ()
        if stated != numbers:
            yield f"docs/releasing.md: expected {name} {numbers} (got {stated}); say what is read of older ones"


def check_contract(root: Path) -> Iterator[str]:
    """Yield public names that the last tag had and this code lacks, unless the version allows their removal.

    It does if its first number, or before version 1 its second one, has risen.
    """
    tags = [t for t in _git(root, "tag", "--list", "v*").splitlines() if re.fullmatch(r"v\d+(\.\d+)+", t)]
    if not tags:
        return
    last = max(tags, key=lambda t: Version(t[1:]))
    before, now = Version(last[1:]), Version(read_version(root))
    names = read_public_names(_git(root, "show", f"{last}:__init__.py"))
    gone = names - read_public_names((root / "__init__.py").read_text(encoding="utf-8"))
    broken = now.major == before.major and (now.major > 0 or now.minor == before.minor)
    if gone and broken:
        which = "first" if now.major else "second"
        yield f"public names of {last} are gone, {', '.join(sorted(gone))}: raise the {which} number of the version"


def read_public_names(text: str) -> set[str]:
    """Return the names that the text of ``__init__.py`` makes public."""
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "_HOMES":
            return {name for names in ast.literal_eval(node.value).values() for name in names}
    return set()


def check_wheel(root: Path) -> Iterator[str]:
    """Build the wheel of the committed files in ``WHEELS``; yield a fault in it, or in tests/test_packaging.py."""
    shutil.rmtree(WHEELS, ignore_errors=True)
    source = WHEELS / "source"
    source.mkdir(parents=True)
    subprocess.run(f"git archive HEAD | tar -x -C '{source}'", shell=True, cwd=root, check=True)
    pip = (sys.executable, "-m", "pip", "wheel", ".", "--no-deps", "--no-build-isolation", "--quiet", "-w", "..")
    built = subprocess.run(pip, cwd=source, capture_output=True, text=True, check=False)
    shutil.rmtree(source)
    if built.returncode:
        yield f"the wheel is not built: {(built.stderr.strip().splitlines() or ['no reason is given'])[-1]}"
        return
    (wheel,) = WHEELS.glob("*.whl")
    inside = {*zipfile.ZipFile(wheel).namelist()}
    if not wheel.name.startswith(f"mbsbench-{read_version(root)}-"):
        yield f"expected a wheel of {read_version(root)} (got {wheel.name})"
    listed = _git(root, "ls-files", "cli", "harness", "problems", "reports", "solvers").splitlines()
    modules = {f"mbsbench/{f}" for f in listed if f.endswith(".py")}
    if missing := sorted(modules - inside):
        yield f"{len(missing)} modules are not in the wheel, {missing[0]} first"
    tests = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/test_packaging.py")
    if subprocess.run(tests, cwd=root, capture_output=True, check=False).returncode:
        yield "tests/test_packaging.py fails: run it with pytest for the reason"


CHECKS: dict[str, Check] = {
    "version, citation and changelog agree": check_versions,
    "everything is committed": check_tree,
    "published results are of this code": check_published,
    "locks satisfy pyproject.toml": check_locks,
    "formats have the numbers of docs/releasing.md": check_formats,
    "public names of the last release are there": check_contract,
    "the wheel holds what runs": check_wheel,
}


def main() -> int:
    """Run all checks; return 0 if the release can be tagged, else 1."""
    passed = True
    for name, check in CHECKS.items():
        problems = list(check(ROOT))
        passed = passed and not problems
        _say(f"{'ok    ' if not problems else 'FAILED'}  {name}")
        for line in problems:
            _say(f"        {line}")
    version = read_version(ROOT)
    if not passed:
        _say(f"\nversion {version} cannot be released yet")
        return 1
    _say(f"\n{next(WHEELS.glob('*.whl')).relative_to(ROOT)} is made. Nothing is tagged or pushed; to release it:\n")
    _say(f'    git tag -a v{version} -m "mbsbench {version}"\n    git push origin v{version}')
    return 0


def _read_project(root: Path) -> dict:
    return dict(tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"])


def _git(root: Path, *words: str) -> str:
    return subprocess.run(("git", *words), cwd=root, check=True, capture_output=True, text=True).stdout.strip("\n")


def _say(words: str) -> None:
    sys.stdout.write(f"{words}\n")


if __name__ == "__main__":
    sys.exit(main())
