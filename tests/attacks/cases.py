"""The changes of the table (module ``changes``) as edits of bundles; ``python -m tests.attacks.cases`` counts them."""

import contextlib
import importlib.util
import io
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbsbench.harness.results.environment import ROOT

from .bundles import cut_run, make_bundles, write, write_parts
from .changes import (
    BASES,
    EMPTIED,
    HEAD,
    NUMBERS,
    PEAKS_UNDECIDED,
    PROBLEMS,
    RECORDS,
    RUNS,
    SAID_AS,
    SERIES_DECIDED,
    Change,
    to,
)

SPEC = importlib.util.spec_from_file_location("check_bundle", ROOT / "checker" / "check_bundle.py")
checker = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(checker)
TABLE = {"records": RECORDS, "problems": PROBLEMS, "numbers": NUMBERS, "runs": RUNS, "bundle": HEAD}


@dataclass(frozen=True)
class Case:
    """One change: which field, how, in which run, and what must be said."""

    part: str
    field: str
    how: str
    base: str
    says: str
    edit: Callable[[dict[str, bytes]], dict[str, bytes]]
    weakens: bool = False

    @property
    def id(self) -> str:
        return f"{self.part} {self.field}: {self.how}"


def edit_record(name: str, change: Change) -> Callable:
    """Change a column of the record; the table is made anew."""

    def edit(files: dict[str, bytes]) -> dict[str, bytes]:
        (record,), (run,) = json.loads(files["records.json"]), json.loads(files["runs.json"])
        record[name] = change(record[name])
        return files | write_parts(record, run)

    return edit


def edit_json(find: Callable[[dict[str, bytes]], str], path: tuple[Any, ...], change: Change) -> Callable:
    """Change a value inside a JSON file."""

    def edit(files: dict[str, bytes]) -> dict[str, bytes]:
        name = find(files)
        plain = json.loads(files[name])
        inside = plain
        for key in path[:-1]:
            inside = inside[key]
        inside[path[-1]] = change(inside[path[-1]])
        return files | {name: json.dumps(plain).encode()}

    return edit


def edit_series(name: str) -> Callable:
    """Raise the middle value of a series."""

    def edit(files: dict[str, bytes]) -> dict[str, bytes]:
        (run,) = json.loads(files["runs.json"])
        member, (at, shape) = f"series/{run['run_id']}.npy", run["arrays"][name]
        values = np.frombuffer(files[member], "<f8", offset=128).copy()
        one = values[at : at + shape[0]]
        k = np.argmax(np.abs(np.nan_to_num(one))) if name == "eq81_norm" else shape[0] // 2
        one[k] = 1.1 * one[k] + 1e-3
        return files | {member: files[member][:128] + values.tobytes()}

    return edit


def problem_file(files: dict[str, bytes]) -> str:
    return next(name for name in files if name.startswith("problems/"))


def list_cases(bases: dict[str, dict[str, bytes]]) -> Iterator[Case]:
    """List every change of the table."""
    edits = {
        "records": edit_record,
        "problems": lambda name, change: edit_json(problem_file, (name,), change),
        "numbers": lambda name, change: edit_json(problem_file, ("numbers", name), change),
        "runs": lambda name, change: edit_json(lambda files: "runs.json", (0, name), change),
        "bundle": lambda name, change: edit_json(lambda files: "bundle.json", (name,), change),
    }
    for part, rows in TABLE.items():
        for name, row in rows.items():
            for how, change in row.changes.items():
                says = name if row.says is None else row.says
                if part == "records" and name in SAID_AS and how != "below zero":
                    says = SAID_AS[name]
                yield Case(part, name, how, row.base, says, edits[part](name, change), row.weakens)
    none = EMPTIED.changes["none of several"]
    empty = edit_json(problem_file, ("invariants",), none)
    yield Case("problems", "invariants", "emptied", "top", EMPTIED.says or "", empty, True)
    for base in ("top", "wrong"):
        (run,) = json.loads(bases[base]["runs.json"])
        for name in run["peaks_s"]:
            if not name.startswith(PEAKS_UNDECIDED):
                later = edit_json(lambda files: "runs.json", (0, "peaks_s", name), lambda at: at / 2 + 1e-4)
                yield Case("peaks", name, f"moved ({base})", base, "", later)
    for name in SERIES_DECIDED:
        base = "planar" if name == "out_of_plane" else "top"
        says = "eq81_max_sqrtJ" if name == "eq81_norm" else f"series {name}"
        yield Case("series", name, "raised", base, says, edit_series(name))
    yield from list_scenes()


def list_scenes() -> Iterator[Case]:
    """List changes of several fields: what hides a run, or turns a law off."""

    def records(**columns: Any) -> Callable:
        def edit(files: dict[str, bytes]) -> dict[str, bytes]:
            (record,), (run,) = json.loads(files["records.json"]), json.loads(files["runs.json"])
            return files | write_parts(record | columns, run)

        return edit

    def hide(files: dict[str, bytes]) -> dict[str, bytes]:
        (record,), (run,) = json.loads(files["records.json"]), json.loads(files["runs.json"])
        run |= {"states": "none", "problem": "", "peaks_s": {}, "arrays": {}, "reactions": {}}
        parts = ("runs/", "series/", "problems/", "references/")
        return {n: raw for n, raw in files.items() if not n.startswith(parts)} | write_parts(record, run)

    yield Case("scene", "a success", "without evidence", "top", "evidence", hide)
    yield Case(
        "scene",
        "a wrong run",
        "a success without evidence",
        "wrong",
        "evidence",
        lambda files: hide(records(status="success", wrong_because="[]")(files)),
    )
    yield Case(
        "scene",
        "a wrong run",
        "called refused",
        "wrong",
        "refused",
        records(status="refused", claimed="refused", wrong_because="[]"),
    )
    yield Case(
        "scene", "a failure", "called refused", "failed", "refused", records(status="refused", claimed="refused")
    )
    yield Case(
        "scene",
        "a success",
        "called crashed",
        "top",
        "reactions",
        records(status="crashed", claimed="", ended_by="exception", counters="{}"),
    )
    yield Case("scene", "a crash", "called a success", "crashed", "", records(status="success"))
    yield Case(
        "scene",
        "a crash",
        "claimed a success",
        "crashed",
        "evidence",
        records(status="success", claimed="success", ended_by="solver"),
    )
    yield Case("scene", "a refusal", "called a success", "refused", "", records(status="success"))
    yield Case("scene", "suite.toml", "junk", "top", "suite.toml", lambda files: files | {"suite.toml": b"\xff = ["})
    yield Case(
        "scene", "suite.toml", "of another name", "top", "suite.toml", lambda files: files | {"suite.toml": b"name = 3"}
    )
    yield Case("scene", "a suite", "most of it left out", "top", "runs of the suite", lambda files: files, True)
    yield Case(
        "scene",
        "a problem",
        "of nobody",
        "top",
        "files",
        lambda files: files | {"problems/0000000000000000.json": b"{}"},
    )

    def without_reactions(files: dict[str, bytes]) -> dict[str, bytes]:
        return records(
            **dict.fromkeys(("reaction_error_max_N", "reaction_size_N", "moment_error_max_Nm", "moment_size_Nm"), "nan")
        )(files)

    yield Case("scene", "reactions", "left out of the record", "top", "without reactions", without_reactions, True)
    literal = edit_json(problem_file, ("literal_start",), to(True))
    yield Case(
        "scene",
        "a literal start",
        "of a wrong run",
        "wrong",
        "literal_start",
        lambda files: literal(records(status="success", wrong_because="[]")(files)),
    )


def judge(path: Path, files: dict[str, bytes], *, complete: bool = False) -> tuple[int, str]:
    """The exit code and the words of the checker."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = checker.main(write(path, files), complete)
    return code, out.getvalue()


def is_found(case: Case, bases: dict[str, dict[str, bytes]], folder: Path) -> tuple[bool, str]:
    """Whether the checker says what it must of a change."""
    path = folder / "b.zip"
    code, text = judge(path, case.edit(dict(bases[case.base])))
    return (bool(code) or case.weakens) and case.says in text, text


def main() -> None:
    """Print how many changes are found, those that are not, and the fields that no bundle decides."""
    with tempfile.TemporaryDirectory() as place:
        files = make_bundles(Path(place))["lossless"]
        bases = {name: cut_run(files, where) for name, where in BASES.items()}
        cases = list(list_cases(bases))
        missed = [case.id for case in cases if not is_found(case, bases, Path(place))[0]]
    rows = {f"{part}.{name}": row for part, some in TABLE.items() for name, row in some.items()}
    left = [f"{name}: {row.undecided}" for name, row in rows.items() if row.undecided and not row.changes]
    lines = [f"{len(cases) - len(missed)} of {len(cases)} changes found", *missed]
    lines += [f"{len(left)} of {len(rows)} fields undecided:", *left]
    sys.stdout.write("".join(f"{line}\n" for line in lines))


if __name__ == "__main__":
    main()
