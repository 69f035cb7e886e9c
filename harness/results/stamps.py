"""Check that a results folder is as its command left it: stamp, suite, records and series.

The digests are not secret: they reveal damage and changes by hand, not forgery.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError, parse_json, read_text
from .records import RunRecord, format_record

NAME = "environment.json"  # the stamp's file
SEAL, FILES = "sha256", "files_sha256"  # keys: the digest of all other keys, and digests of the files beside it
# names of the suite files beside a stamp
BESIDE = re.compile(r"[\w-]+\.toml")
LARGEST = 2**22  # [bytes] of a stamp or a suite: what is read is held in memory, and the file may be a stranger's


def seal_stamp(stamp: Mapping[str, Any], texts: Mapping[str, str]) -> dict[str, Any]:
    """Return the stamp with the digests of the suite files beside it, and with its own digest, which covers these.

    ``texts`` are the contents of the suite files by name.
    """
    whole = {**stamp, FILES: {name: _digest(text.encode()) for name, text in texts.items()}}
    return {**whole, SEAL: _digest_stamp(whole)}


def find_changed(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield the stamp and each suite file beside it that was changed after it was written, with the reason.

    A stamp with another digest is yielded alone. An older stamp has no digests and yields nothing.
    """
    place = ConfinedPath(folder) / NAME
    if place.kind() != "a file":  # missing, or a link, which is refused when opened
        return
    try:
        stamp = parse_json(read_text(place, "environment"), NAME)
    except FileError as error:
        yield place.path, str(error)
        return
    if not isinstance(stamp, dict) or SEAL not in stamp:
        return
    if _digest_stamp(stamp) != stamp[SEAL]:
        yield place.path, "its digest does not match: it was changed after its suite was run"
        return
    files = stamp.get(FILES)
    if not isinstance(files, dict) or not all(map(BESIDE.fullmatch, files)):
        yield place.path, f"{FILES} must be a table of digests by names of suites (got {str(files)[:40]})"
        return
    for name, digest in files.items():
        beside = ConfinedPath(folder) / name
        if beside.kind() == "a file" and beside.size() <= LARGEST and _digest(beside.read(LARGEST)) != digest:
            yield beside.path, f"not as {NAME} says: it was changed after it was run"


def is_intact(folder: Path, expected: RunRecord, found: RunRecord | None) -> bool:
    """Return whether ``found``, a run's record as read from disk, equals ``expected``, the one that was written.

    Its series file, if it has one, must be unchanged too; False for a missing record (None).
    """
    return found is not None and format_record(found) == format_record(expected) and has_intact_series(folder, found)


def has_intact_series(folder: Path, record: RunRecord) -> bool:
    """Return whether a record's series file, if it has one, still has the digest in the record."""
    if not record.series:
        return True
    try:
        with (ConfinedPath(folder) / record.series).open_file() as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == record.series_sha256  # type: ignore[arg-type]
    except OSError:
        return False


def _digest_stamp(stamp: Mapping[str, Any]) -> str:
    """Return the digest of all keys of a stamp except that digest itself."""
    return _digest(json.dumps({k: v for k, v in stamp.items() if k != SEAL}, sort_keys=True).encode())


def _digest(content: bytes) -> str:
    """Return the sha256 of ``content``."""
    return hashlib.sha256(content).hexdigest()
