"""Digest the code that a run's numbers come from, without running it: its motion apart from what is measured of it.

A motion, with its cost, comes from the code of its solver, of its problem, and of what runs both (``running``). What is
measured of it comes from the code that measures series and judges them (``measuring``), and from the function of each
column (``columns``, module ``column_codes``): runs stay when these change, and are measured again.

The digest of a solver or problem covers its file and every module of the package that this imports, directly or
indirectly; so do those of running and measuring. It is computed from the syntax tree without docstrings and shapes of
arrays, so that comments and formatting do not count either. Outside packages count by their locked version. Code that
only looks up, checks, stores or shows is excluded (``ARRANGES``): no number of a run passes through it. Code that
counts CPU time (``COSTS``) is part of running: a cost is a number of each run and can only be obtained by running
again.
"""

import ast
import hashlib
import itertools
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from ..base.cache import ROOT, make_cache_folder, read_sealed_file, write_sealed_file
from ..columns.digests import ColumnDigests
from .column_codes import DECLARED, digest_columns
from .plugins import list_sources
from .syntax import digest_texts, find_imports, flatten

VERSION = 2  # version of a file's digest; raise it when the output of ``syntax.flatten`` changes
LARGE = 2**20  # [bytes] of the cache between processes; a larger one is started anew
# modules and folders through which no number of a run passes
ARRANGES = (
    "harness/base/cache",
    "harness/base/confined_paths",
    "harness/base/files",
    "harness/base/hints",
    "harness/base/machine",
    "harness/base/naming",
    "harness/base/shapes",
    "harness/catalogue/codes",
    "harness/catalogue/column_codes",
    "harness/catalogue/functions",
    "harness/catalogue/mechanism",
    "harness/catalogue/options",
    "harness/catalogue/plugins",
    "harness/catalogue/suites",
    "harness/catalogue/syntax",
    "harness/catalogue/trial",
    "harness/columns/digests",
    "harness/results",
    "harness/run/handover",
    "harness/run/job",
)
SHARED = "harness/catalogue/registry"  # rotates, mirrors and perturbs problems: part of no solver or problem
COSTS = (  # modules that count CPU time
    "harness/base/clock",
    "harness/run/run",
    "harness/run/worker",
    "harness/base/forked_process",
    "harness/base/isolation",
)
# modules that pass a problem to a solver and count what it takes, without those that they import
RUNNING = ("harness/run/contract", "harness/run/presenting", *COSTS, SHARED)
MEASURING = ("harness/run/measuring",)  # measures and judges a motion
MEASURES = ("harness/columns", "harness/judge", "harness/reference", *MEASURING)  # shape no motion
WORDS = "harness/columns/declaring"  # what a column is called and where it is shown: shapes no number
LISTED = ("harness/mechanics/joints/kinds", "solvers/engines/inside")  # folders whose files are listed, not imported
MARKED = {"solver": ("solvers", "solvers/engines"), "problem": ("problems",)}  # folders by decorator of their entries
LOCKED_AS = {"sksundae": "scikit-sundae", "scipy_dae": "scipy-dae", "yaml": "pyyaml"}  # package by module, if different
# name and version in a line of the lock file
LOCKED = re.compile(r"^([A-Za-z0-9_.-]+)==(\S+)", re.MULTILINE)


@dataclass(frozen=True)
class Source:
    """A module: the digest of its syntax tree, its imports, and the problems and solvers that it defines."""

    digest: str
    imports: tuple[str, ...]  # paths in the package; some are names inside a module
    outside: tuple[str, ...]  # packages from outside that it imports
    marks: tuple[str, ...]  # problems and solvers that it defines: ``solver:rattle``


class Sources:
    """The modules of the package in the folder ``root``, each digested when first needed.

    ``keep`` is a file in which the digests of modules are cached for the next process.
    """

    def __init__(self, root: Path = ROOT, keep: Path | None = None) -> None:
        self.root, self._keep = root, keep
        self._known: dict[str, Source] = _read_cached(keep) if keep else {}
        self._of: dict[str, Source] = {}
        self._fresh = False

    def digest_run_code(self, problem: str, solver: str, plugins: Iterable[str] = ()) -> str:
        """Return the digest of all code that shapes the motion and the cost of a run of this solver on this problem.

        A solver or problem of a plugin is covered by the digest of the files of ``plugins``.
        """
        return digest_run(self.solvers.get(solver, ""), self.problems.get(problem, ""), self.running, plugins)

    def digest_all(self, plugins: Iterable[str] = ()) -> str:
        """Return the digest of all solvers and problems, of running and measuring, and of the files of ``plugins``."""
        named = itertools.chain(*self.solvers.items(), *self.problems.items())
        return _digest_with([*named, self.running, self.measuring], plugins)

    @cached_property
    def solvers(self) -> dict[str, str]:
        """The digest of each solver of the catalogue, by name."""
        return self._digest_marked("solver")

    @cached_property
    def problems(self) -> dict[str, str]:
        """The digest of each problem of the catalogue, by name."""
        return self._digest_marked("problem")

    @cached_property
    def running(self) -> str:
        """The digest of the code that passes a problem to a solver, checks the result, and counts its cost."""
        return self.digest_modules(*RUNNING, without=MEASURES)

    @cached_property
    def measuring(self) -> str:
        """The digest of the code that measures and judges a motion, without the functions of single columns."""
        return self.digest_modules(*MEASURING, without=(DECLARED, WORDS))

    @cached_property
    def columns(self) -> ColumnDigests:
        """The digests of measuring and of the function of each measured column."""
        return ColumnDigests(self.measuring, digest_columns(self.root, self.digest_modules, self.list_versions))

    def digest_modules(self, *modules: str, without: tuple[str, ...] = ()) -> str:
        """Return one digest of ``modules``, such as ``solvers/rattle``, all they import and versions of packages.

        Modules and folders in ``without`` are left out. Modules that had to be parsed are cached on disk.
        """
        found = self._digest_imported(*modules, without=without)
        self._store_parsed()
        return found

    def _digest_imported(self, *modules: str, without: tuple[str, ...] = ()) -> str:
        """Return the digest that ``digest_modules`` returns; leave the cache on disk as it is."""
        seen, outside = self.list_imported(*modules, without=without)
        return digest_texts([*self.list_versions(outside), *itertools.chain(*sorted(seen.items()))])

    def list_versions(self, outside: Iterable[str]) -> list[str]:
        """Return the outside packages with their locked versions, ``numpy==2.1.0``, sorted; others are left out."""
        locked, names = self._locked_versions, (LOCKED_AS.get(m, m) for m in outside)
        return sorted(f"{n}=={locked[n]}" for n in names if n in locked)

    def list_imported(self, *modules: str, without: tuple[str, ...] = ()) -> tuple[dict[str, str], set[str]]:
        """Return the files of ``modules`` and of all they import, with digests, and the names of outside packages.

        Modules in ``ARRANGES`` and ``without``, and ``SHARED``, are left out unless they are among ``modules``.
        """
        asked = [place for m in modules if (place := self._find_file(m))]
        seen, outside, waiting = dict[str, str](), set[str](), list(asked)
        while waiting:
            place = waiting.pop()
            excluded = is_inside(place, (*ARRANGES, *without)) or place == f"{SHARED}.py"
            if place in seen or (place not in asked and excluded):
                continue
            source = self._read_source(place)
            seen[place] = source.digest
            outside.update(source.outside)
            waiting += [f for m in source.imports if (f := self._find_file(m))]
            if place.removesuffix("/__init__.py") in LISTED:
                waiting += [str(p.relative_to(self.root)) for p in sorted((self.root / place).parent.glob("*.py"))]
        return seen, outside

    def _digest_marked(self, kind: str) -> dict[str, str]:
        """Return, by name, the digest of each entry of a ``kind``, ``problem`` or ``solver``, of the catalogue."""
        out = {}
        for folder in MARKED[kind]:
            for path in sorted((self.root / folder).glob("*.py")):
                place = f"{folder}/{path.stem}"
                for mark in self._read_source(f"{place}.py").marks:
                    if mark.startswith(f"{kind}:"):
                        out[mark.partition(":")[2]] = self._digest_imported(place)
        self._store_parsed()
        return dict(sorted(out.items()))

    @cached_property
    def _locked_versions(self) -> dict[str, str]:
        """The version of each outside package in the lock file; empty without one."""
        lock = self.root / "locks" / "requirements.lock"
        return dict(LOCKED.findall(lock.read_text(encoding="utf-8"))) if lock.is_file() else {}

    @cache  # noqa: B019 - one object a process
    def _find_file(self, module: str) -> str | None:
        """Return the file of a module, relative to the root; None if the package has no such module."""
        for place in (f"{module}.py", f"{module}/__init__.py"):
            if (self.root / place).is_file():
                return place
        return None

    def _read_source(self, place: str) -> Source:
        """Return digest, imports and entries of the module in the file ``place``; parse it unless it is cached."""
        if place not in self._of:
            content = (self.root / place).read_bytes()
            key = f"{VERSION} {place} {hashlib.sha256(content).hexdigest()}"
            if key not in self._known:
                self._known[key], self._fresh = _parse_source(content, place), True
            self._of[place] = self._known[key]
        return self._of[place]

    def _store_parsed(self) -> None:
        """Write the parsed modules to the cache for the next process; if it cannot be written, only time is lost."""
        if self._fresh and self._keep:
            rows = {k: [s.digest, s.imports, s.outside, s.marks] for k, s in self._known.items()}
            write_sealed_file(self._keep, json.dumps(rows).encode())
        self._fresh = False


@cache
def package_sources() -> Sources:
    """Return the sources of this package, one object in each process."""
    return Sources(ROOT, make_cache_folder("sources", ROOT / "results" / "local") / "parsed.json")


def digest_run_code(problem: str, solver: str, plugins: Iterable[str] = ()) -> str:
    """Return the digest of the code of a run made here, as in the column ``code``."""
    return package_sources().digest_run_code(problem, solver, plugins)


def list_run_digests(problem: str, solver: str, root: Path = ROOT) -> dict[str, str]:
    """Return the digests of a run's solver, problem and running code in the folder ``root``, each by a phrase."""
    here = package_sources() if root == ROOT else _open_sources(root)
    return {
        "its solver": here.solvers.get(solver, ""),
        "its problem": here.problems.get(problem, ""),
        "what runs it and counts its cost": here.running,
    }


@cache
def _open_sources(root: Path) -> Sources:
    """Return the sources of the package in another folder, one object in each process."""
    return Sources(root)


def read_column_digests() -> ColumnDigests:
    """Return the digests of the code of columns that are measured here; the column ``measured_by`` has their digest."""
    return package_sources().columns


@cache
def digest_code(plugins: tuple[str, ...] = ()) -> str:
    """Return the digest of all code that shapes the numbers of runs, of this package and of ``plugins``."""
    return package_sources().digest_all(plugins)


def digest_run(solver: str, problem: str, running: str, plugins: Iterable[str] = ()) -> str:
    """Return the digest of the code of a run from those of its solver, its problem, what runs them, and plugins."""
    return _digest_with([solver, problem, running], plugins)


def is_inside(place: str, modules: Iterable[str]) -> bool:
    """Return whether the file ``place`` is one of these modules, or in a folder of that name."""
    return any(place == f"{a}.py" or place.startswith(f"{a}/") for a in modules)


def _digest_with(parts: list[str], plugins: Iterable[str]) -> str:
    """Return the digest of the texts ``parts``, to which names and digests of the plugins' files are appended."""
    for path in itertools.chain.from_iterable(map(list_sources, plugins)):
        parts += [path.name, hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""]
    return digest_texts(parts)


def _read_cached(keep: Path) -> dict[str, Source]:
    """Return the parsed modules in the cache file ``keep``, by version, path and content; empty if it is unusable."""
    try:
        rows = json.loads(read_sealed_file(keep, LARGE))
        return {k: Source(str(d), *(tuple(map(str, x)) for x in (i, o, m))) for k, (d, i, o, m) in rows.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _parse_source(content: bytes, place: str) -> Source:
    """Return digest, imports and catalogue entries of a module with this content, in the file ``place``."""
    tree = ast.parse(content)
    inside, outside = dict[str, None](), dict[str, None]()
    for module in find_imports(tree, place.removesuffix(".py").split("/")):
        first, _, rest = module.partition("/")  # a path in this package begins with a slash
        (inside if first == "" else outside)[rest if first == "" else first] = None
    marks = tuple(f"{kind}:{name}" for kind, name in _find_marks(tree))
    return Source(digest_texts(flatten(tree)), tuple(inside), tuple(outside), marks)


def _find_marks(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield kind and name of each problem and solver that a module defines, as in ``@solver("rattle")``."""
    for node in tree.body:
        for call in getattr(node, "decorator_list", ()):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in MARKED and call.args:
                name = call.args[0]
                if isinstance(name, ast.Constant) and isinstance(name.value, str):
                    yield call.func.id, name.value
