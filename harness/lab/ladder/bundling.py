"""Write the bundle of a submission from its results folder, and read such bundles as untrusted data."""

import hashlib
import json
import math
import subprocess
import sys
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

from ...base.confined_paths import open_whole
from ...base.files import FileError, parse_json, parse_toml
from ...base.forked_process import ForkedProcess
from ...base.text import escape_text
from ...mechanics.types import Status
from ...results import records, store
from ...results.environment import ROOT
from ...results.records import RunRecord
from ...run.run import Send
from ..bundle.archive import MANIFEST, write_archive
from ..bundle.contents import list_contents
from .closing import LadderClosing
from .instances import KINDS, STEPS, Instance, InstanceKind, draw_instances

CHECKER = ROOT / "checker" / "check_bundle.py"
CHECK_LIMIT, CHECK_MEMORY = 60.0, 4000.0  # [s] of CPU time and [MB] for the checker
ABOUT = ("submission", "digest", "seed")  # required keys of suite.toml
CONTROL = {"dt": "dt_s", "rtol": "rtol"}  # columns of records by step control
LARGEST_BUNDLE = 2**30  # [bytes] of all its files
LARGEST = 2**26  # [bytes] of the suite and of all records together


@dataclass(frozen=True)
class Entry:
    """A bundle of the ladder: its solver and runs, and why it is no valid entry."""

    file: str
    solver: str
    digest: str  # of the submission
    seed: str  # the value that instances were drawn with
    records: tuple[RunRecord, ...]
    forged: tuple[str, ...] = ()  # why it is no valid entry
    fenced: bool = False  # whether its runs were confined, according to who ran them


def write_bundle(folder: Path, path: Path) -> None:
    """Write the newest results of each run in ``folder`` as the lossless bundle ``path``."""
    write_archive(path, list_contents(folder, store.select_newest(store.load(folder).records), lossless=True))


def read_entry(path: Path, kinds: tuple[InstanceKind, ...] = KINDS, closing: LadderClosing | None = None) -> Entry:
    """Return a bundle as an entry, whose ``forged`` says why it is invalid; never raise an exception.

    Its manifest, instances, numbers and seed are checked, and with ``closing`` whether the ladder admits it. ``kinds``
    are the problems that the ladder draws instances of.
    """
    try:
        entry = _read_entry(path, kinds)
    except Exception as error:  # a foreign file may raise anything, and must cost this entry alone
        words = " ".join(str(getattr(error, "strerror", None) or error).split()) or type(error).__name__
        entry = _make_invalid_entry(path, f"it is no bundle of a submission: {words}")
    if closing and not entry.forged and (words := closing.explain_rejection(entry.digest, entry.seed)):
        return replace(entry, forged=(words,))
    return entry


def _make_invalid_entry(path: Path, *why: str) -> Entry:
    """Return an entry without results, for a file that is no valid bundle, with the reasons ``why``."""
    return Entry(escape_text(path.name), escape_text(path.stem), "", "", (), tuple(map(escape_text, why)))


def _read_entry(path: Path, kinds: tuple[InstanceKind, ...]) -> Entry:
    """Return a bundle as an entry with all reasons against it; raise any exception if it is not a bundle."""
    with open_whole(path, LARGEST_BUNDLE) as file, zipfile.ZipFile(file) as archive:
        if found := _check_manifest(archive):
            return _make_invalid_entry(path, *found)
        about = parse_toml(_read_member(archive, "suite.toml"), "suite.toml")
        plain = parse_json(_read_member(archive, "records.json"), "records.json")
    if missing := [name for name in ABOUT if name not in about]:
        return _make_invalid_entry(path, f"its suite.toml has no {', '.join(missing)}")
    solver, digest, seed = (str(about[name]) for name in ABOUT)
    if not solver.isidentifier():
        return _make_invalid_entry(path, f"its solver has no name of one: {solver[:100]!r}")
    given = tuple(records.parse_record_json(json.dumps(one)) for one in plain)
    found = [f"{r.case}: {words}" for r in given if (words := _find_impossible_number(r))]
    found += _check_instances(given, solver, draw_instances(digest, seed, kinds))
    found += check_bundle(path)
    fenced = about.get("fenced") is True
    return Entry(escape_text(path.name), solver, digest, seed, given, tuple(map(escape_text, found)), fenced)


def _check_manifest(archive: zipfile.ZipFile) -> list[str]:
    """Return a line for each file of a bundle that differs from its manifest; a single line if it is malformed."""
    sizes = {m.filename: m.file_size for m in archive.infolist()}
    if len(sizes) != len(archive.infolist()) or MANIFEST not in sizes or sum(sizes.values()) > LARGEST_BUNDLE:
        return [f"a name twice, no {MANIFEST}, or more than {LARGEST_BUNDLE} bytes"]
    lines = _read_member(archive, MANIFEST).splitlines()
    stated = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
    found = {name: _digest_member(archive, name) for name in sizes if name != MANIFEST}
    return [f"{name} is not as its manifest says" for name in sorted(dict(found.items() ^ stated.items()))]


def _digest_member(archive: zipfile.ZipFile, name: str) -> str:
    """Return the sha256 of a file in a ZIP archive, in hexadecimal digits."""
    with archive.open(name) as member:  # digested in pieces, since it may be as large as a bundle
        return hashlib.file_digest(member, "sha256").hexdigest()  # type: ignore[arg-type]


def _read_member(archive: zipfile.ZipFile, name: str) -> str:
    """Return the text of a file in a ZIP archive; raise FileError if it is missing, too large, or not UTF-8."""
    if name not in archive.namelist():
        raise FileError(f"it has no {name}")
    if archive.getinfo(name).file_size > LARGEST:
        raise FileError(f"{name} is too large")
    try:
        return archive.read(name).decode()
    except UnicodeDecodeError as error:
        raise FileError(f"{name} is no text in UTF-8: {error.reason} at byte {error.start}") from None


def _find_impossible_number(r: RunRecord) -> str:
    """Return which value of a record no run of the ladder can have, in words; empty if there is none."""
    if r.status not in set(Status):
        return f"no status {r.status!r}"
    if r.control not in STEPS or getattr(r, CONTROL[r.control]) not in STEPS[r.control]:
        return "no setting of the ladder"
    if r.status == Status.SUCCESS and not (
        0.0 <= r.motion_error_max_m < math.inf and 0.0 < r.length_scale_m < math.inf
    ):
        return "a success without an error"
    return "" if 0.0 < r.cpu_median_s < math.inf or r.status != Status.SUCCESS else "a success without a CPU time"


def _check_instances(given: tuple[RunRecord, ...], solver: str, drawn: tuple[Instance, ...]) -> list[str]:
    """Return a line for each way in which the records differ from one run per drawn instance and setting.

    ``given`` are the records, ``solver`` the entry's, ``drawn`` the instances of its digest and seed.
    """
    lines = [f"{r.case}: a run of {r.solver}" for r in given if r.solver != solver]
    expected = {(i.problem, json.dumps(dict(i.parameters), sort_keys=True)) for i in drawn}
    found_settings = [(r.problem, json.dumps(dict(r.parameters), sort_keys=True), r.dt_s, r.rtol) for r in given]
    if {h[:2] for h in found_settings} != expected:
        lines.append("its instances are not those drawn for its digest and seed")
    runs = len(expected) * len(next(iter(STEPS.values())))
    if len({str(h) for h in found_settings}) != len(found_settings) or len(found_settings) != runs:
        lines.append("a run is missing, or there twice")
    return lines


def require_checker() -> None:
    """Raise FileError if the independent checker is missing: no bundle can be trusted without it."""
    if not CHECKER.is_file():
        raise FileError(f"bundles cannot be ranked without the independent checker: {CHECKER} is missing; reinstall")


def check_bundle(path: Path) -> list[str]:
    """Return where the independent checker disagrees with a bundle, at most five lines; empty if it agrees.

    The checker demands the states of every success. It runs in a process with limits, which count as a disagreement if
    they are exceeded. Raise FileError if the checker is missing.
    """
    require_checker()
    line = (sys.executable, str(CHECKER), "--complete", str(path))

    def check(send: Send) -> None:
        """Run the checker, and send its exit code and output."""
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        send(json.dumps([done.returncode, (done.stdout or done.stderr)]))

    ended = ForkedProcess(check, limit=CHECK_LIMIT, memory=CHECK_MEMORY).wait()
    code, said = json.loads(ended.sent) if ended.sent else (ended.code, "")
    if code < 0 or not ended.sent:
        return [f"the checker {replace(ended, code=code).describe_limit(CHECK_LIMIT, CHECK_MEMORY) or ended.words}"]
    lines = said.strip().splitlines()
    # the first line has counts, indented lines have details
    differing = [line for line in lines[1:] if not line.startswith(" ")][:5]
    return [] if code == 0 else differing or lines or ["it disagrees"]
