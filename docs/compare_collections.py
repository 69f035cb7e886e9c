"""Read public collections of MJCF and URDF by the readers, and compare each file that is read with another code.

    python docs/compare_collections.py COLLECTIONS.toml OUTCOMES.jsonl
    python docs/compare_collections.py           # writes the tables of the page from published data

The first compares all files and writes ``results/published/collections.json`` and the tables. OUTCOMES.jsonl has a line
for each file: what the present readers have done is not done again. COLLECTIONS.toml lists the collections, copies of
which are kept outside this project, with their meshes::

    [[collection]]
    name = "bulletphysics/bullet3"
    commit = "6c888f4abd7b46f572587360cc214985f02e5c6b"
    folder = "/data/bullet3"

Every ``.urdf``, and every ``.xml`` with an element ``mujoco``, is read in a process of its own with limits on time and
memory, and compared by ``other_models`` and ``pinocchio_models``. A file that is read and disagrees, though all that
its reader names as omitted is taken away on the other side, is a fault of the reader.
"""

import importlib
import json
import os
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import numpy as np
from other_models import (  # type: ignore[import-not-found]  # beside this file
    SAME,
    WITHIN,
    MujocoModel,
    NotComparableError,
)
from pinocchio_models import PinocchioModel  # type: ignore[import-not-found]

from mbsbench.harness.base.forked_process import ForkedProcess
from mbsbench.harness.catalogue.codes import package_sources
from mbsbench.harness.formats.mechanisms.mechanism import CompiledMechanism
from mbsbench.harness.formats.mechanisms.mechanism_files import read_mechanism

HERE = Path(__file__).resolve().parent
PAGE, PUBLISHED = HERE / "your-own-problem.md", HERE.parent / "results" / "published" / "collections.json"
TABLES = re.compile(
    r"(?<=<!-- made from results/published/collections\.json by compare_collections\.py -->\n).*?(?=<!-- end -->)",
    re.DOTALL,
)
READERS = "harness/formats/mechanisms/mechanism_files"
LIMIT, MEMORY = 60.0, 4000.0  # [s, MB] of a file
SEED = 45  # of the random states
MOST = 8  # reasons of refusals on the page
FAILED, REFUSED, DIFFERS, OPEN = "failed", "refused", "differs", "not compared"
AGREES, WITHOUT = "agrees", "agrees without"
KINDS = {
    REFUSED: "refused",
    AGREES: "agree",
    WITHOUT: "agree without",
    DIFFERS: "differ",
    OPEN: "not compared",
    FAILED: "crash, limit",
}
REASONS = {  # kinds of refusals, and a pattern of their messages: the first that is found counts
    "nothing that moves": "nothing in it can move",
    "couplings of joints or tendons": "couplings of type|is coupled to",
    "joints of one body that are together none": "are together no supported joint",
    "inertias from meshes": "has its inertia from a mesh",
    "flexible bodies and plugins": "flexible bodies and plugins",
    "bodies that move without mass or inertia": "it has no mass|mjMINVAL|has inertia and no mass|has no inertia about",
    "inertias of no rigid body or below 1e-15 kg m2": "no rigid body has|must satisfy A|positive eigenvalues",
    "macros of xacro": "macro of xacro",
    "limits that lock a joint elsewhere than at 0": "limits that lock joint",
    "loops of a body with itself": "to itself",
    "unknown elements and attributes": "not supported within|attribute .* is not supported",
    "text that is no such file": "not XML|XML Error|XML parse error|expected a robot element|Error opening file",
    "names, numbers or parts that are missing or wrong": "expected|must be|parent already|no link|not found|unrecog",
}


@dataclass(frozen=True)
class Outcome:
    """The outcome of a file: its kind (``KINDS``) with a reason or a difference, and what the reader omitted."""

    collection: str
    file: str
    code: str  # digest of the readers and all they import
    kind: str
    words: str = ""  # why it was refused or not compared
    omitted: tuple[str, ...] = ()
    difference: float | None = None  # largest relative difference of accelerations
    left_out: int = 0  # states near singular poses of loops, which are not compared

    def __post_init__(self) -> None:
        """Make a tuple of the list that a line of JSON has."""
        object.__setattr__(self, "omitted", tuple(self.omitted))

    @property
    def format(self) -> str:
        """The format of the file."""
        return "URDF" if self.file.lower().endswith(".urdf") else "MJCF"


def list_models(folder: Path) -> Iterator[Path]:
    """Yield the files of models below ``folder``: URDF, and XML with an element ``mujoco``."""
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in (".urdf", ".xml") and p.is_file()):
        if path.suffix.lower() == ".urdf" or re.search(rb"<mujoco\b", path.read_bytes()):
            yield path


def compare_file(path: Path) -> dict[str, Any]:
    """Read a file and compare it with the other code; return kind, words, omitted parts and difference.

    First only stops and contacts are taken away on the other side, then all that the reader names.
    """
    try:
        mechanism = read_mechanism(path)
        mechanism.problem()
    except ValueError as error:
        return {"kind": REFUSED, "words": str(error)}
    assert isinstance(mechanism, CompiledMechanism)
    omitted = {str(kind) for kind in mechanism.omitted}
    out: dict[str, Any] = {}
    for away, kind in ((omitted & WITHIN, AGREES), (omitted, WITHOUT)):
        try:
            other = PinocchioModel(path) if path.suffix.lower() == ".urdf" else MujocoModel(path)
            other.remove(away)
            samples = other.make_samples(mechanism, np.random.default_rng(SEED))
            largest = max(sample.measure_difference() for sample in samples)
            out = {"kind": kind if largest < SAME else DIFFERS, "difference": largest, "left_out": other.left_out}
        except NotComparableError as error:
            out = {"kind": OPEN, "words": str(error)}
        except MemoryError:
            out = {"kind": OPEN, "words": f"dense matrices of its parts take more than {MEMORY:g} MB"}
        except ValueError as error:
            out = {"kind": DIFFERS, "words": str(error)}  # a state that the other code's joints allow
        if out["kind"] == kind:
            break
    return out | {"omitted": sorted(omitted)}


def run_apart(path: Path) -> dict[str, Any]:
    """Return ``compare_file(path)`` from a process of its own; a crash or a limit is an outcome, too."""

    def target(send: Callable[[str], None]) -> None:
        """Send the outcome as a line of JSON."""
        os.chdir(folder)  # where MuJoCo writes its log
        send(json.dumps(compare_file(path)))

    with TemporaryDirectory() as folder:
        ended = ForkedProcess(target, limit=LIMIT, memory=MEMORY).wait()
    if ended.sent.strip():
        return dict(json.loads(ended.sent))
    return {"kind": FAILED, "words": ended.describe_limit(LIMIT, MEMORY) or ended.words}


def compare_collections(collections: Sequence[dict[str, str]], log: Path) -> list[Outcome]:
    """Return the outcomes of all files of the collections; those in ``log``, by the same code, are not made again."""
    code = package_sources().digest_modules(READERS)
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    logged = (Outcome(**json.loads(line)) for line in lines)
    known = {(one.collection, one.file): one for one in logged if one.code == code}
    for name in ("mujoco", "pinocchio"):  # once, before any process is forked
        importlib.import_module(name)
    out = []
    with log.open("a", encoding="utf-8") as written:
        for one in collections:
            folder = Path(one["folder"])
            for path in list_models(folder):
                key = one["name"], path.relative_to(folder).as_posix()
                if key not in known:
                    known[key] = Outcome(*key, code, **run_apart(path))
                    written.write(json.dumps(asdict(known[key])) + "\n")
                    written.flush()
                out.append(known[key])
    return out


def summarise(collections: Sequence[dict[str, str]], outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the published data: counts by collection and format, refusals by reason, files that are not compared."""
    rows = []
    for one in collections:
        for form in ("MJCF", "URDF"):
            found = Counter(o.kind for o in outcomes if o.collection == one["name"] and o.format == form)
            if found:
                rows.append({"name": one["name"], "commit": one["commit"], "format": form, "counts": {**found}})
    compared = [o for o in outcomes if o.kind in (AGREES, WITHOUT)]
    return {
        "code": sorted({o.code for o in outcomes}),
        "versions": {name: version(name) for name in ("mujoco-core", "pin")},
        "same": SAME,
        "collections": rows,
        "refusals": {
            form: dict(Counter(find_reason(o.words) for o in outcomes if o.kind == REFUSED and o.format == form))
            for form in ("MJCF", "URDF")
        },
        "taken away": dict(Counter(kind for o in outcomes if o.kind == WITHOUT for kind in o.omitted)),
        "largest difference": max((o.difference or 0.0 for o in compared), default=0.0),
        "singular": sum(o.left_out > 0 for o in compared),
        "open": {f"{o.collection}: {o.file}": o.words for o in outcomes if o.kind in (OPEN, FAILED)},
        "differ": {f"{o.collection}: {o.file}": o.words or o.difference for o in outcomes if o.kind == DIFFERS},
    }


def find_reason(message: str) -> str:
    """Return the kind of a refusal (``REASONS``); ``other`` if no pattern is found in it."""
    return next((kind for kind, pattern in REASONS.items() if re.search(pattern, message)), "other")


def format_tables() -> str:
    """Return the tables of the page: counts by collection, then reasons of refusals."""
    data = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    total = {
        form: sum((Counter(row["counts"]) for row in data["collections"] if row["format"] == form), Counter[str]())
        for form in ("MJCF", "URDF")
    }
    said = ", ".join(f"{c.total()} {form} ({c.total() - c[REFUSED] - c[FAILED]} read)" for form, c in total.items())
    versions = " and ".join(f"{name} {number}" for name, number in data["versions"].items())
    lines = [
        fill(
            f"By {versions}: {said}. Accelerations at the "
            f"start and two random states differ by at most {data['largest difference']:.0e} of each body's where "
            f"they agree (bound {data['same']:g}). *Without*: after parts that the reader names as omitted and that "
            "act there are taken away on the other side. States near singular poses of loops, where accelerations "
            f"are not determined, are left out ({data['singular']} files).",
            98,
        ),
        "",
        f"| collection | commit | format | {' | '.join(KINDS.values())} |",
        "|---" * (3 + len(KINDS)) + "|",
    ]
    for row in data["collections"]:
        cells = (row["counts"].get(kind, 0) for kind in KINDS)
        lines.append(f"| {row['name']} | {row['commit'][:8]} | {row['format']} | {' | '.join(map(str, cells))} |")
    for form, counts in total.items():
        lines.append(f"| all | | {form} | {' | '.join(str(counts[kind]) for kind in KINDS)} |")
    for form, reasons in data["refusals"].items():
        most = sorted(reasons.items(), key=lambda pair: (pair[0] == "other", -pair[1]))[:MOST]
        rest = sum(reasons.values()) - sum(n for _, n in most)
        listed = "; ".join([f"{kind} {n}" for kind, n in most] + ([f"other {rest}"] if rest else []))
        lines += ["", fill(f"{form} is refused for: {listed}.", 98)]
    if data["open"]:
        said = "; ".join(f"{words} ({n})" for words, n in Counter(data["open"].values()).items())
        lines += ["", fill(f"Read and not compared: {said}.", 98)]
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> None:
    """Compare the collections that are given, if any, and write the tables of the page."""
    if arguments:
        collections = tomllib.loads(Path(arguments[0]).read_text(encoding="utf-8"))["collection"]
        data = summarise(collections, compare_collections(collections, Path(arguments[1])))
        PUBLISHED.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(TABLES.sub(lambda _: format_tables(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
