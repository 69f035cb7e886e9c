"""Know mechanisms from files: what the catalogue needs of one, and the readers, which a copy may lack."""

import importlib
import importlib.util
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ..mechanics.system import MultibodySystem
from ..mechanics.types import Problem
from .options import Parameter

READERS = "formats.mechanisms.mechanism_files"  # in this package; found by name, since the room can be deleted
# extensions that a copy without readers names as such, instead of suggesting a problem of a similar name
UNREADABLE = (".xml", ".mjcf", ".urdf", ".sdf", ".world", ".usd", ".usda", ".usdc", ".usdz")


@dataclass(frozen=True)
class MechanismFile(ABC):
    """A file of a mechanism that has been read; its problem is created from it with parameters."""

    name: str
    path: Path
    sha256: str  # digest of the file and those it includes

    @property
    @abstractmethod
    def doc(self) -> str:
        """The source of the problem: the file, its reader, and what was omitted."""

    @abstractmethod
    def parameters(self) -> dict[str, tuple[Any, Parameter]]:
        """Return the parameters of its start, by name with their defaults, in addition to those of all problems."""

    @abstractmethod
    def problem(self, **given: Any) -> Problem:
        """Return the problem with these parameters and a start that closes its loops."""

    @abstractmethod
    def system(self) -> MultibodySystem:
        """Return its system; raise ValueError where a joint is not supported."""

    def _describe(self, reader: str, omitted: Mapping[Any, int]) -> str:
        """Return the source of the problem as text: file, digest, reader, and counts of what is omitted."""
        said = ", ".join(f"{what} ({n})" for what, n in omitted.items())
        read = f"{self.path.name} (sha256 {self.sha256}), read by {reader}"
        return f"{read}; omitted: {said}" if said else read


@cache
def load_readers() -> Any:
    """Return the module that reads mechanisms' files; None in a copy of the package without ``harness/formats``.

    The first call imports it. A process that forks runs makes that call before, so that no run is charged for it.
    """
    harness = (__package__ or "").rpartition(".")[0]
    there = importlib.util.find_spec(f"{harness}.{READERS.partition('.')[0]}")
    return importlib.import_module(f"{harness}.{READERS}") if there and there.origin else None


def is_mechanism(name: str) -> bool:
    """Return whether ``name`` has the extension of a mechanism's file.

    Raise ValueError for such a file in a copy of the package without readers.
    """
    suffix = Path(name).suffix.lower()
    readers = load_readers() if suffix not in ("", ".py") else None
    if readers is None and suffix in UNREADABLE:
        raise ValueError(f"{name}: this copy of mbsbench has no readers of mechanisms' files (harness/formats)")
    return readers is not None and suffix in readers.SUFFIXES


def choose_name(path: str | Path) -> str:
    """Return the name of the problem in a file: its stem, with ``_`` for characters that a shell would quote."""
    return re.sub(r"[^\w+-]+", "_", Path(path).stem)


def list_files(path: Path) -> tuple[Path, ...]:
    """Return the mechanism's file and those that it includes, on which its motion depends."""
    return tuple(load_readers().list_files(path))


def digest_mechanism(path: Path) -> str:
    """Return a digest of the mechanism's file and of those that it includes."""
    return str(load_readers().digest_mechanism(path))


def read_mechanism(path: Path) -> MechanismFile:
    """Return the mechanism in a file; raise ValueError with a message of one line if it cannot be read."""
    out: MechanismFile = load_readers().read_mechanism(path)
    return out
