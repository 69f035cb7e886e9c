"""Open files and folders below a results folder without following links or opening devices and pipes.

A results folder may come from anybody, and may change while it is read. Every part of a path is therefore opened in the
descriptor of the folder above it, without following links, and the descriptor is examined, not the name. Only the path
to the results folder itself is the user's and may contain links (``results/local/latest`` is one).
"""

import contextlib
import errno
import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
ALWAYS = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC  # O_NONBLOCK: do not wait for a pipe without a writer
PARTIAL = re.compile(r"\..+\.\d+\.part(\.\w+)?")  # the name of a file that is being written
KINDS = {
    stat.S_IFREG: "a file",
    stat.S_IFDIR: "a folder",
    stat.S_IFLNK: "a link",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
OWN = ("", "a file", "a folder")
LARGEST = 2**30  # [bytes] of a file that a user names


class UnsafeFile(OSError):
    """A link, a device or anything else in the place of a file or folder."""


@dataclass(frozen=True)
class ConfinedPath:
    """A file or folder below ``root``, a folder that the user named; ``parts`` are the names that lead to it."""

    root: Path
    parts: tuple[str, ...] = ()

    def __truediv__(self, name: str) -> "ConfinedPath":
        """Return the path ``name`` below this one; raise ValueError if it could lead out of it."""
        parts = tuple(name.split("/"))
        if any(part in ("", ".", "..") or "\0" in part for part in parts):
            raise ValueError(f"{name!r} must be a path below {self}, without empty parts, . and ..")
        return ConfinedPath(self.root, (*self.parts, *parts))

    def __str__(self) -> str:
        return str(self.path)

    @property
    def path(self) -> Path:
        """The path, for messages and for uses outside the results folder; never to be opened."""
        return self.root.joinpath(*self.parts)

    @property
    def name(self) -> str:
        return self.parts[-1] if self.parts else self.root.name

    @property
    def parent(self) -> "ConfinedPath":
        """The folder above it, also for the results folder itself."""
        return ConfinedPath(self.root, self.parts[:-1])

    def sibling(self, name: str) -> "ConfinedPath":
        """Return the path ``name`` in the same folder."""
        return self.parent / name

    def kind(self) -> str:
        """Return ``a file``, ``a folder``, ``a link`` and so on; empty if nothing exists."""
        try:
            with self.parent.open_folder() as above:
                return _read_kind(above, self.name) if self.parts else "a folder"
        except (FileNotFoundError, NotADirectoryError):  # NotADirectoryError if the results folder is a file
            return ""

    def is_there(self) -> bool:
        """Return whether a file or folder exists; raise UnsafeFile for anything else, such as a link."""
        if (kind := self.kind()) not in OWN:
            raise self._make_refusal(kind)
        return bool(kind)

    def is_own_file(self) -> bool:
        """Return whether it exists and is a regular file; raise UnsafeFile for a link and the like."""
        return self.is_there() and self.kind() == "a file"

    def is_folder(self) -> bool:
        """Return whether it exists and is a folder; raise UnsafeFile for a link and the like."""
        return self.is_there() and self.kind() == "a folder"

    def names(self) -> list[str]:
        """Return the names of the entries of this folder, sorted; an empty list if it does not exist."""
        try:
            with self.open_folder() as here:
                return sorted(os.listdir(here))
        except FileNotFoundError:
            return []

    def make_folder(self) -> None:
        """Make this folder and its parents below the results folder, which must exist."""
        with self.open_folder(make=True):
            pass

    def open_file(self, flags: int = os.O_RDONLY) -> BinaryIO:
        """Open the file with ``flags``, to be read or written in bytes; raise UnsafeFile if it is no regular file."""
        with self.parent.open_folder() as above:
            return self._open_in(above, flags)

    def _open_in(self, above: int, flags: int) -> BinaryIO:
        """Open the file in the folder with the descriptor ``above``, as ``open_file`` does."""
        try:
            descriptor = os.open(self.name, flags | ALWAYS, 0o666, dir_fd=above)
        except OSError as error:
            raise self._explain(error, above) from None
        if not stat.S_ISREG(mode := os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise self._make_refusal(KINDS.get(stat.S_IFMT(mode), "no regular file"))
        return os.fdopen(descriptor, "rb" if flags & 3 == os.O_RDONLY else "r+b", buffering=-1)

    def size(self) -> int:
        """Return the size of the file [bytes]."""
        with self.open_file() as file:
            return os.fstat(file.fileno()).st_size

    def read(self, largest: int) -> bytes:
        """Read the file; raise OSError if it exceeds ``largest`` bytes."""
        with self.open_file() as file:
            return self._read_open(file, largest)

    def contents(self, largest: int) -> Iterator[tuple[str, bytes | OSError]]:
        """Yield the name of each file in this folder, sorted, and its content or the error of reading it.

        Names with a leading dot are skipped; a file of more than ``largest`` bytes is an error.
        """
        names = [name for name in self.names() if not name.startswith(".")]
        with self.open_folder() as here:
            for name in names:
                place = self / name
                try:
                    with place._open_in(here, os.O_RDONLY) as file:
                        yield name, place._read_open(file, largest)
                except OSError as error:
                    yield name, error

    def _read_open(self, file: BinaryIO, largest: int) -> bytes:
        """Read the rest of the open ``file``; raise OSError if it has more than ``largest`` bytes."""
        size = os.fstat(file.fileno()).st_size
        if size > largest:
            raise OSError(errno.EFBIG, f"it has {size} bytes, more than {largest}", str(self))
        return file.read(size)

    @contextmanager
    def write_atomically(self, *, durable: bool = True) -> Iterator[BinaryIO]:
        """Provide a new file to write, which replaces this one when the block ends and is removed if the block fails.

        Missing folders are created. Other names of an old file (hard links) keep its content. With ``durable`` it is
        on the disk when the block ends, which takes milliseconds; files that can be made again do not need it.
        """
        partial = format_partial_name(self.name, os.getpid())
        with self.parent.open_folder(make=True) as above:
            if (kind := _read_kind(above, self.name)) not in ("", "a file"):
                raise self._make_refusal(kind)
            with self._create(partial, above) as file:
                try:
                    yield file
                    file.flush()
                    if durable:
                        os.fsync(file.fileno())
                    os.replace(partial, self.name, src_dir_fd=above, dst_dir_fd=above)
                except BaseException:  # on Ctrl-C, too, no half-written file stays
                    with contextlib.suppress(FileNotFoundError):
                        os.unlink(partial, dir_fd=above)
                    raise

    def write(self, content: bytes | str, *, durable: bool = True) -> None:
        """Write the file atomically."""
        with self.write_atomically(durable=durable) as file:
            file.write(content.encode() if isinstance(content, str) else content)

    def open_new(self) -> BinaryIO:
        """Create an empty file in place of any old one, with missing folders; return it, opened for appending."""
        with self.parent.open_folder(make=True) as above:
            if (kind := _read_kind(above, self.name)) not in ("", "a file"):
                raise self._make_refusal(kind)
            return self._create(self.name, above, os.O_APPEND)

    def remove_file(self, *, missing_ok: bool = False) -> None:
        """Remove the file, or a folder with all in it; a link is removed, not its target.

        Raise FileNotFoundError if nothing exists, unless ``missing_ok``.
        """
        try:
            with self.parent.open_folder() as above:
                if _read_kind(above, self.name) == "a folder":
                    shutil.rmtree(self.name, dir_fd=above)
                else:
                    os.unlink(self.name, dir_fd=above)
        except FileNotFoundError:
            if not missing_ok:
                raise

    def remove_folder(self) -> None:
        """Remove this folder, if it exists, with all in it; links in it are removed, not their targets."""
        if self.is_folder():
            with self.parent.open_folder() as above:
                shutil.rmtree(self.name, dir_fd=above)

    def move_to(self, target: "ConfinedPath") -> None:
        """Rename this file, folder or link to ``target``, whose folder is created if it is missing."""
        with self.parent.open_folder() as here, target.parent.open_folder(make=True) as there:
            os.rename(self.name, target.name, src_dir_fd=here, dst_dir_fd=there)

    @contextmanager
    def open_folder(self, *, make: bool = False) -> Iterator[int]:
        """Provide a descriptor of this folder for the block; with ``make`` create missing folders down to it.

        Raise UnsafeFile for a link or the like in place of a folder on the path below ``root``.
        """
        at = os.open(self.root, FOLDER)
        try:
            for k, part in enumerate(self.parts):
                if make:
                    with contextlib.suppress(FileExistsError):
                        os.mkdir(part, dir_fd=at)
                try:
                    below = os.open(part, FOLDER | os.O_NOFOLLOW, dir_fd=at)
                except OSError as error:
                    raise ConfinedPath(self.root, self.parts[: k + 1])._explain(error, at, "a folder") from None
                os.close(at)
                at = below
            yield at
        finally:
            os.close(at)

    def _create(self, name: str, above: int, more: int = 0) -> BinaryIO:
        """Create the file ``name`` in the folder with descriptor ``above``, in place of an old one.

        ``more`` are further flags to open it with.
        """
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name, dir_fd=above)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | more | ALWAYS
        return os.fdopen(os.open(name, flags, 0o666, dir_fd=above), "w+b")

    def _explain(self, error: OSError, above: int, wanted: str = "a file") -> OSError:
        """Return the error to raise for ``error``, met on opening this path in the folder with descriptor ``above``.

        It is UnsafeFile if the path is anything but ``wanted``, else the same error with the path.
        """
        kind = _read_kind(above, self.name)
        if kind not in ("", wanted):
            return self._make_refusal(kind)
        return OSError(error.errno, error.strerror, str(self))

    def _make_refusal(self, kind: str) -> UnsafeFile:
        """Return the UnsafeFile to raise for a ``kind`` of entry, such as ``a link``, in place of a file or folder."""
        words = f"it is {kind}; a results folder holds files and folders of its own only: remove it"
        return UnsafeFile(errno.EINVAL, words, str(self))


def confine_path(path: Path | ConfinedPath) -> ConfinedPath:
    """Return a path that the user named, confined to the folder that contains it; return a ConfinedPath unchanged.

    Links on the path to that folder are followed: the user chose it. The last name is not trusted: others may have
    replaced the file, and methods of the result refuse a link or a device in its place.
    """
    if isinstance(path, ConfinedPath):
        return path
    path = path if path.name not in ("", "..") else Path(os.path.abspath(path))  # "." has no name of its own
    return ConfinedPath(path.parent) / path.name


def read_whole(path: Path, largest: int = LARGEST) -> bytes:
    """Return the content of a file that the user named; raise OSError unless it is regular and within ``largest``."""
    with open_whole(path, largest) as file:
        return file.read(os.fstat(file.fileno()).st_size)


@contextmanager
def open_whole(path: Path, largest: int = LARGEST) -> Iterator[BinaryIO]:
    """Open a file that the user named, through links too: a regular file of at most ``largest`` bytes.

    Raise OSError for anything else: a pipe would block, a device would never end.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    about, why = os.fstat(descriptor), (0, "")
    if not stat.S_ISREG(about.st_mode):
        why = errno.EINVAL, f"it is {KINDS.get(stat.S_IFMT(about.st_mode), 'no regular file')}, not a file"
    elif about.st_size > largest:
        why = errno.EFBIG, f"it has {about.st_size} bytes, more than {largest}"
    if why[0]:
        os.close(descriptor)
        raise OSError(*why, str(path))
    with os.fdopen(descriptor, "rb") as file:
        yield file


def format_partial_name(name: str, pid: int) -> str:
    """Return the name that process ``pid`` gives a file before it becomes ``name``; the suffix is kept."""
    path = Path(name)
    return f".{path.stem}.{pid}.part{path.suffix}"


def _read_kind(above: int, name: str) -> str:
    """Return the kind of ``name`` in the folder with descriptor ``above``, such as ``a link``; empty if none exists."""
    try:
        return KINDS.get(stat.S_IFMT(os.stat(name, dir_fd=above, follow_symlinks=False).st_mode), "no regular file")
    except FileNotFoundError:
        return ""
