"""A zip file with the same bytes on every machine, and its SHA-256 manifest."""

import hashlib
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path

from ..files import FileError, whole

MANIFEST = "manifest-sha256.txt"  # as sha256sum writes and checks it
EPOCH = (1980, 1, 1, 0, 0, 0)
NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")


def write_archive(path: Path, members: Iterable[tuple[str, bytes]]) -> int:
    """Write ``members`` in their order, then the manifest, whole or not at all; returns how many files these are.

    bzip2 has one implementation; the bytes that deflate gives depend on the library behind it.
    """
    digests: dict[str, str] = {}
    with whole(path) as partial, zipfile.ZipFile(partial, "x") as archive:
        for name, content in members:
            _write_member(archive, name, content, digests)
        lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items()))
        _write_member(archive, MANIFEST, lines.encode(), {})
    return len(digests) + 1


def _write_member(archive: zipfile.ZipFile, name: str, content: bytes, digests: dict[str, str]) -> None:
    if not NAME.fullmatch(name) or name in digests:
        raise FileError(f"{name!r} cannot be the name of a file in a bundle")
    digests[name] = hashlib.sha256(content).hexdigest()
    member = zipfile.ZipInfo(name, EPOCH)
    member.create_system, member.external_attr = 3, 0o100644 << 16  # as written on Unix, everywhere
    archive.writestr(member, content, zipfile.ZIP_BZIP2, 9)
