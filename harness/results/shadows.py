"""Provide true motions near runs, as ``mbsbench shadow RUN`` stored them, or else the published ones."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from .judgements.files import PUBLISHED
from .records import RunRecord

FILE = "shadows.json"  # file of a results folder, by run_id
CHAOS = "chaos.json"  # published for the chain at the default settings of ``solve``
LARGEST = 2**24  # [bytes]: what is read is held in memory, and the file may be a stranger's
SYMPLECTIC = 1e-10  # relative oscillation of the modified energy below which a fixed-step method counts as symplectic


@dataclass(frozen=True)
class NearestMotion:
    """The distance and duration of a nearby true motion, and the modified energy's oscillation; None if unknown."""

    until_s: float | None = None  # time up to which a true motion stays near
    largest_m: float | None = None  # its largest distance from the computed one
    rms_m: float | None = None
    modified_energy: float | None = None  # oscillation relative to the energy scale
    published: bool = False  # True if of a published run with these settings, by older code

    @property
    def words(self) -> str:
        """The motion in words, ``a true motion within 0.577 mm (rms 0.165 mm) over 5 s``; empty if it is unknown."""
        if not self.until_s or self.largest_m is None or self.rms_m is None:
            return ""
        words = f"a true motion within {_length(self.largest_m)} (rms {_length(self.rms_m)}) over {self.until_s:.4g} s"
        return f"{words}, as published" if self.published else words

    @property
    def symplectic(self) -> str:
        """``yes`` if the modified energy does not oscillate, else ``not shown``; empty if there is none.

        A large oscillation proves nothing, as it may come from coarse steps.
        """
        return "" if self.modified_energy is None else "yes" if self.modified_energy < SYMPLECTIC else "not shown"


def read_nearest(folder: Path) -> dict[str, NearestMotion]:
    """Return the nearest true motions of a folder's runs by run_id, and the published ones of the chain by case.

    Raise FileError if a file is invalid; a missing one counts as empty.
    """
    published = _read(PUBLISHED / CHAOS, dict[str, dict[str, Any]]).get("runs", {})
    out = {f"chain {name} {row['setting']}": _parse_row(row) for name, row in published.items()}
    return out | _read(ConfinedPath(folder) / FILE, dict[str, NearestMotion])


def choose_nearest(record: RunRecord, known: dict[str, NearestMotion]) -> NearestMotion | None:
    """Return the nearest motion of the run itself, else the published one with its settings; None without either."""
    return known.get(record.run_id) or known.get(record.case)


def store_nearest(folder: Path, record: RunRecord, nearest: NearestMotion) -> None:
    """Add the nearest true motion of a run to ``shadows.json`` of its results folder; replace an earlier one."""
    place = ConfinedPath(folder) / FILE
    rows = _read(place, dict[str, NearestMotion]) | {record.run_id: nearest}
    place.write(json.dumps({k: asdict(v) for k, v in sorted(rows.items())}, indent=1) + "\n")


def _parse_row(row: dict[str, Any]) -> NearestMotion:
    """Return the nearest motion in a row of the published file, parsed from JSON."""
    shadow = row["shadow"]
    return NearestMotion(
        shadow.get("until_s"), shadow.get("largest_m"), shadow.get("rms_m"), row["modified_energy"], True
    )


def _read(place: ConfinedPath, kind: Any) -> Any:
    """Return the content of a JSON file as the type ``kind``, empty without a file; raise FileError if invalid."""
    try:
        return msgspec.json.decode(place.read(LARGEST), type=kind)
    except FileNotFoundError:
        return {}
    except (OSError, msgspec.MsgspecError) as error:
        raise FileError(f"{place}: {error}") from None


def _length(value: float) -> str:
    """Return a length [m] as text, in millimetres, or in metres if it is tiny."""
    return f"{1e3 * value:.3g} mm" if value >= 1e-5 else f"{value:.2g} m"
