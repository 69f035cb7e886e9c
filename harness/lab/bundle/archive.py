"""Write a zip file with the same bytes on every machine, and its SHA-256 manifest."""

import hashlib
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path

from ...base.files import FileError, write_atomically

MANIFEST = "manifest-sha256.txt"  # in the format of sha256sum
EPOCH = (1980, 1, 1, 0, 0, 0)
NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")


def write_archive(path: Path, members: Iterable[tuple[str, bytes]]) -> int:
    """Write the files ``members`` in their order, then the manifest, to the zip file ``path``; return their number.

    The file is written completely or not at all. Compression is bzip2, which has one implementation; the bytes that
    deflate gives depend on the library behind it.
    """
    digests: dict[str, str] = {}
    with write_atomically(path) as partial, zipfile.ZipFile(partial, "x") as archive:
        for name, content in members:
            _write_member(archive, name, content, digests)
        lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items()))
        _write_member(archive, MANIFEST, lines.encode(), {})
    return len(digests) + 1


def _write_member(archive: zipfile.ZipFile, name: str, content: bytes, digests: dict[str, str]) -> None:
    """Write a file into the archive and its SHA-256 into ``digests``; raise FileError for an invalid or repeated name.

    Time, rights and system are the same for all, so that equal content gives equal bytes.
    """
    if not NAME.fullmatch(name) or name in digests:
        raise FileError(f"{name!r} cannot be the name of a file in a bundle")
    digests[name] = hashlib.sha256(content).hexdigest()
    member = zipfile.ZipInfo(name, EPOCH)
    member.create_system, member.external_attr = 3, 0o100644 << 16  # mark the file as written on Unix on every system
    archive.writestr(member, content, zipfile.ZIP_BZIP2, 9)
