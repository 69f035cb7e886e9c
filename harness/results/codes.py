"""Digests of the code that a run's numbers come from: by solver, by problem and of measuring; nothing of it is run.

The digest of a solver covers its file and every module of the package that this imports, directly or through others;
so does that of a problem, and of what calls solvers and measures their motions. It is taken of the syntax tree without
docstrings and the shapes of arrays, so that neither they nor comments and formatting count. Of packages from outside
the locked version counts. What only looks up, checks, stores or shows is no part of it (``ARRANGES``): no number of a
run passes through. What counts CPU time (``COSTS``) is part of measuring: a cost is a number of each run and can only
be had by running again.
"""

import ast
import contextlib
import hashlib
import itertools
import json
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from ..cache import ROOT, cache_folder
from ..catalogue.plugins import sources_of
from ..files import write_text

VERSION = 2  # of the digest of one file; raise it when ``_flatten`` writes something else
LARGE = 2**20  # [bytes] of what is kept between processes; more is begun anew
ARRANGES = (
    "harness/cache", "harness/catalogue/functions", "harness/catalogue/links", "harness/catalogue/mechanism",
    "harness/catalogue/mechanism_files", "harness/catalogue/options", "harness/catalogue/plugins",
    "harness/catalogue/sdformat", "harness/catalogue/usd",
    "harness/execution/handover", "harness/execution/job", "harness/files", "harness/machine", "harness/places",
    "harness/results",
    "harness/sandbox/trial", "harness/shapes", "harness/suites",
)  # fmt: skip
SHARED = "harness/catalogue/registry"  # turns, mirrors and perturbs problems: no part of one solver or problem
COSTS = ("harness/clock", "harness/execution/run", "harness/execution/worker", "harness/sandbox/apart",
         "harness/sandbox/isolation")  # fmt: skip
MEASURING = (
    "harness/execution/contract",
    "harness/execution/measuring",
    "harness/execution/presenting",
    *COSTS,
    SHARED,
)
LISTED = ("harness/mechanics/joints/kinds", "solvers/engines/inside")  # folders whose files are listed, not imported
MARKED = {"solver": ("solvers", "solvers/engines"), "problem": ("problems",)}
LOCKED_AS = {"sksundae": "scikit-sundae", "scipy_dae": "scipy-dae", "yaml": "pyyaml"}  # where the names differ
LOCKED = re.compile(r"^([A-Za-z0-9_.-]+)==(\S+)", re.MULTILINE)
WITHOUT = frozenset(("ctx", "kind", "type_comment", "type_params", "type_ignores"))  # same code, other versions
SHAPED = ("Bool", "Complex", "Float", "Inexact", "Int", "Num", "Shaped")  # arrays, as annotations call them


@dataclass(frozen=True)
class Source:
    """One module: the digest of its syntax tree, what it imports, and the entries of the catalogue that it marks."""

    digest: str
    imports: tuple[str, ...]  # places in the package, of which some are names in a module
    outside: tuple[str, ...]
    marks: tuple[str, ...]  # ``solver:rattle``


class Sources:
    """The modules of the package below ``root``."""

    def __init__(self, root: Path = ROOT, keep: Path | None = None) -> None:
        self.root, self._keep = root, keep
        self._known: dict[str, Source] = _read_kept(keep) if keep else {}
        self._of: dict[str, Source] = {}
        self._fresh = False

    def code_of(self, problem: str, solver: str, plugins: Iterable[str] = ()) -> str:
        """Digest of all that shapes the numbers of a run; entries that are not ours are covered by ``plugins``."""
        return digest_run(self.solvers.get(solver, ""), self.problems.get(problem, ""), self.measuring, plugins)

    def digest_all(self, plugins: Iterable[str] = ()) -> str:
        """Digest of all solvers and problems, of measuring, and of ``plugins``."""
        return _digest_with([*itertools.chain(*self.solvers.items(), *self.problems.items()), self.measuring], plugins)

    @cached_property
    def solvers(self) -> dict[str, str]:
        """The digest of each solver of the catalogue."""
        return self._digest_marked("solver")

    @cached_property
    def problems(self) -> dict[str, str]:
        """The digest of each problem of the catalogue."""
        return self._digest_marked("problem")

    @cached_property
    def measuring(self) -> str:
        """The digest of what hands a problem to a solver, checks what it returns, and measures it and its cost."""
        return self.of(*MEASURING)

    def of(self, *modules: str) -> str:
        """The digest of modules (``solvers/rattle``) and of all they import."""
        seen, outside = self.reach(*modules)
        locked, names = self._locked_versions, (LOCKED_AS.get(m, m) for m in outside)
        versions = sorted(f"{n}=={locked[n]}" for n in names if n in locked)
        return _digest([*versions, *itertools.chain(*sorted(seen.items()))])

    def reach(self, *modules: str) -> tuple[dict[str, str], set[str]]:
        """Files of modules and of all they import, with their digests; and names of packages from outside."""
        asked = [place for m in modules if (place := self._file(m))]
        seen, outside, waiting = dict[str, str](), set[str](), list(asked)
        while waiting:
            place = waiting.pop()
            if place in seen or (place not in asked and (self._arranges(place) or place == f"{SHARED}.py")):
                continue
            source = self._source(place)
            seen[place] = source.digest
            outside.update(source.outside)
            waiting += [f for m in source.imports if (f := self._file(m))]
            if place.removesuffix("/__init__.py") in LISTED:
                waiting += [str(p.relative_to(self.root)) for p in sorted((self.root / place).parent.glob("*.py"))]
        self._store()
        return seen, outside

    def _digest_marked(self, kind: str) -> dict[str, str]:
        out = {}
        for folder in MARKED[kind]:
            for path in sorted((self.root / folder).glob("*.py")):
                place = f"{folder}/{path.stem}"
                for mark in self._source(f"{place}.py").marks:
                    if mark.startswith(f"{kind}:"):
                        out[mark.partition(":")[2]] = self.of(place)
        return dict(sorted(out.items()))

    @cached_property
    def _locked_versions(self) -> dict[str, str]:
        lock = self.root / "requirements.lock"
        return dict(LOCKED.findall(lock.read_text(encoding="utf-8"))) if lock.is_file() else {}

    @staticmethod
    def _arranges(place: str) -> bool:
        return any(place == f"{a}.py" or place.startswith(f"{a}/") for a in ARRANGES)

    @cache  # noqa: B019 - one object a process
    def _file(self, module: str) -> str | None:
        for place in (f"{module}.py", f"{module}/__init__.py"):
            if (self.root / place).is_file():
                return place
        return None

    def _source(self, place: str) -> Source:
        if place not in self._of:
            content = (self.root / place).read_bytes()
            key = f"{VERSION} {place} {hashlib.sha256(content).hexdigest()}"
            if key not in self._known:
                self._known[key], self._fresh = _parse_source(content, place), True
            self._of[place] = self._known[key]
        return self._of[place]

    def _store(self) -> None:
        """Keep what was parsed for the next process; a folder that cannot be written only costs time."""
        if self._fresh and self._keep:
            rows = {k: [s.digest, s.imports, s.outside, s.marks] for k, s in self._known.items()}
            with contextlib.suppress(OSError):
                self._keep.parent.mkdir(parents=True, exist_ok=True)
                write_text(self._keep, json.dumps(rows))
        self._fresh = False


@cache
def package_sources() -> Sources:
    """The modules of this package."""
    return Sources(ROOT, cache_folder("sources", ROOT / "results" / "local") / "parsed.json")


def code_of(problem: str, solver: str, plugins: Iterable[str] = ()) -> str:
    """The digest that a run made here has as its column ``code``."""
    return package_sources().code_of(problem, solver, plugins)


def digest_run(solver: str, problem: str, measuring: str, plugins: Iterable[str] = ()) -> str:
    """Return the digest of a run from those of its solver, its problem and of measuring."""
    return _digest_with([solver, problem, measuring], plugins)


def _digest_with(parts: list[str], plugins: Iterable[str]) -> str:
    for path in itertools.chain.from_iterable(map(sources_of, plugins)):
        parts += [path.name, hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""]
    return _digest(parts)


def _read_kept(keep: Path) -> dict[str, Source]:
    try:
        if not 0 < os.stat(keep).st_size < LARGE:
            return {}
        rows = json.loads(keep.read_text(encoding="utf-8"))
        return {k: Source(str(d), *(tuple(map(str, x)) for x in (i, o, m))) for k, (d, i, o, m) in rows.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _parse_source(content: bytes, place: str) -> Source:
    tree = ast.parse(content)
    inside, outside = dict[str, None](), dict[str, None]()
    for module in _find_imports(tree, place.removesuffix(".py").split("/")):
        first, _, rest = module.partition("/")
        (inside if first == "" else outside)[rest if first == "" else first] = None
    marks = tuple(f"{kind}:{name}" for kind, name in _find_marks(tree))
    return Source(_digest(_flatten(tree)), tuple(inside), tuple(outside), marks)


def _find_imports(tree: ast.AST, place: list[str]) -> Iterator[str]:
    """Modules as places: of the package with a slash before them, packages around a module included."""
    for node in _walk_run(tree):
        if isinstance(node, ast.Import):
            named = [a.name.split(".") for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = (node.module or "").split(".") if node.module else []
            base = ["mbsbench", *place[: len(place) - node.level], *base] if node.level else base
            named = [base, *([*base, a.name] for a in node.names)]
        else:
            continue
        for parts in named:
            if parts[0] == "mbsbench":
                yield from ("/" + "/".join(parts[1:k]) for k in range(2, len(parts) + 1))
            else:
                yield parts[0]


def _walk_run(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes but what is imported for the checker of types alone."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        yield node
        waiting += ast.iter_child_nodes(node)


def _find_marks(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for node in tree.body:
        for call in getattr(node, "decorator_list", ()):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in MARKED and call.args:
                name = call.args[0]
                if isinstance(name, ast.Constant) and isinstance(name.value, str):
                    yield call.func.id, name.value


def _flatten(node: object) -> Iterator[str]:
    """The syntax tree as words, the same in every version of Python: without docstrings, shapes and what is empty."""
    if isinstance(node, ast.AST):
        yield type(node).__name__
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in SHAPED:
            return
        for name, value in ast.iter_fields(node):
            if value is None or value == [] or name in WITHOUT:
                continue
            yield f".{name}"
            yield from _flatten(value)
        yield ")"
    elif isinstance(node, list):
        for one in node:
            if not (
                isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) and isinstance(one.value.value, str)
            ):
                yield from _flatten(one)
    else:
        yield f"{type(node).__name__} {node!r}"


def _digest(parts: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:16]
