"""A zip file with the same bytes on every machine, its SHA-256 manifest, and a check of both."""

import hashlib
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path

from ..files import FileError, whole

MANIFEST = "manifest-sha256.txt"  # as sha256sum writes and checks it
EPOCH = (1980, 1, 1, 0, 0, 0)
NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")
LARGEST = 2**31  # [bytes] of a bundle's content when it is checked here


def write_archive(path: Path, members: Iterable[tuple[str, bytes]]) -> dict[str, str]:
    """Write ``members`` in their order, then the manifest, whole or not at all; returns the digests by name.

    bzip2 has one implementation; the bytes that deflate gives depend on the library behind it.
    """
    digests: dict[str, str] = {}
    with whole(path) as partial, zipfile.ZipFile(partial, "x") as archive:
        for name, content in members:
            _write_member(archive, name, content, digests)
        lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items()))
        _write_member(archive, MANIFEST, lines.encode(), {})
    return digests


def _write_member(archive: zipfile.ZipFile, name: str, content: bytes, digests: dict[str, str]) -> None:
    if not NAME.fullmatch(name) or name in digests:
        raise FileError(f"{name!r} cannot be the name of a file in a bundle")
    digests[name] = hashlib.sha256(content).hexdigest()
    member = zipfile.ZipInfo(name, EPOCH)
    member.create_system, member.external_attr = 3, 0o100644 << 16  # as written on Unix, everywhere
    archive.writestr(member, content, zipfile.ZIP_BZIP2, 9)


def check_archive(path: Path) -> list[str]:
    """Where a bundle differs from its manifest, a line each; empty if nowhere."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = {m.filename: m for m in archive.infolist()}
            if MANIFEST not in members or sum(m.file_size for m in members.values()) > LARGEST:
                return [f"no {MANIFEST}, or more than {LARGEST} bytes"]
            lines = archive.read(MANIFEST).decode().splitlines()
            told = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
            found = [f"{name} is not in the manifest" for name in sorted({*members} - {*told, MANIFEST})]
            found += [f"{name} is missing" for name in sorted({*told} - {*members})]
            for name in sorted({*told} & {*members}):
                if hashlib.sha256(archive.read(name)).hexdigest() != told[name]:
                    found.append(f"{name} was changed")
            return found
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        return [f"not a whole zip file: {error}"]
