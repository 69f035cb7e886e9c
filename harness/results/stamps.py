"""Whether what a results folder holds is as the command that ran it left it: stamp, suite, records and series.

Nobody is kept from writing new digests, too: what is found is damage, and changes made by hand.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..files import FileError, parse_json, read_text
from ..places import Place
from .records import RunRecord, to_json

NAME = "environment.json"
SEAL, FILES = "sha256", "files_sha256"  # keys: the digest of all others, and those of the files beside it
BESIDE = re.compile(r"[\w-]+\.toml")
LARGEST = 2**22  # [bytes] of a stamp or a suite


def seal(stamp: Mapping[str, Any], texts: Mapping[str, str]) -> dict[str, Any]:
    """The stamp with the digests of the files beside it, ``texts`` by name, and its own."""
    whole = {**stamp, FILES: {name: _digest(text.encode()) for name, text in texts.items()}}
    return {**whole, SEAL: _digest_stamp(whole)}


def find_changed(folder: Path) -> Iterator[tuple[Path, str]]:
    """Each of these files that was changed since, and what is wrong; an older stamp has no digests."""
    place = Place(folder) / NAME
    if place.kind() != "a file":  # none, or a link, which whoever opens it refuses
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
        beside = Place(folder) / name
        if beside.kind() == "a file" and beside.size() <= LARGEST and _digest(beside.read(LARGEST)) != digest:
            yield beside.path, f"not as {NAME} says: it was changed after it was run"


def is_there(folder: Path, promised: RunRecord, found: RunRecord | None) -> bool:
    """Whether a record that was written is still the one on disk, with its series."""
    return found is not None and to_json(found) == to_json(promised) and has_its_series(folder, found)


def has_its_series(folder: Path, record: RunRecord) -> bool:
    """Whether the series file of a record, if it has one, is the one that it was written with."""
    if not record.series:
        return True
    try:
        with (Place(folder) / record.series).open_file() as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == record.series_sha256  # type: ignore[arg-type]
    except OSError:
        return False


def _digest_stamp(stamp: Mapping[str, Any]) -> str:
    return _digest(json.dumps({k: v for k, v in stamp.items() if k != SEAL}, sort_keys=True).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
