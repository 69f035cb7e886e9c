"""True motions near runs: those that ``mbsbench shadow RUN`` kept in a results folder, else the published ones."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from ..files import FileError
from ..places import Place
from .judgements.files import PUBLISHED
from .records import RunRecord

FILE = "shadows.json"  # of a results folder, by run_id
CHAOS = "chaos.json"  # published, of the chain at the settings that ``solve`` takes by default
LARGEST = 2**24  # [bytes]
SYMPLECTIC = 1e-10  # swing of the modified energy, of the scale: below it a fixed-step method is taken for symplectic


@dataclass(frozen=True)
class Nearest:
    """How near a true motion is, up to when, and how far the modified energy swings; None where nothing was found."""

    until_s: float | None = None
    largest_m: float | None = None
    rms_m: float | None = None
    modified_energy: float | None = None  # of the scale
    published: bool = False  # of a run with these settings, by the code of its day

    @property
    def words(self) -> str:
        """``a true motion within 0.577 mm (rms 0.165 mm) over 5 s``."""
        if not self.until_s or self.largest_m is None or self.rms_m is None:
            return ""
        words = f"a true motion within {_length(self.largest_m)} (rms {_length(self.rms_m)}) over {self.until_s:.4g} s"
        return f"{words}, as published" if self.published else words

    @property
    def symplectic(self) -> str:
        """The verdict; empty where the modified energy is not defined. A large swing may be one of coarse steps."""
        return "" if self.modified_energy is None else "yes" if self.modified_energy < SYMPLECTIC else "not shown"


def read_nearest(folder: Path) -> dict[str, Nearest]:
    """By run_id those of the folder, by case those published; FileError where a file is not one of these."""
    published = _read(PUBLISHED / CHAOS, dict[str, dict[str, Any]]).get("runs", {})
    out = {f"chain {name} {row['setting']}": _of(row) for name, row in published.items()}
    return out | _read(Place(folder) / FILE, dict[str, Nearest])


def nearest_of(record: RunRecord, known: dict[str, Nearest]) -> Nearest | None:
    """That of the run itself, else of the published one with its settings."""
    return known.get(record.run_id) or known.get(record.case)


def keep_nearest(folder: Path, record: RunRecord, nearest: Nearest) -> None:
    """Beside those of other runs of the folder."""
    place = Place(folder) / FILE
    rows = _read(place, dict[str, Nearest]) | {record.run_id: nearest}
    place.write(json.dumps({k: asdict(v) for k, v in sorted(rows.items())}, indent=1) + "\n")


def _of(row: dict[str, Any]) -> Nearest:
    shadow = row["shadow"]
    return Nearest(shadow.get("until_s"), shadow.get("largest_m"), shadow.get("rms_m"), row["modified_energy"], True)


def _read(place: Place, kind: Any) -> Any:
    try:
        return msgspec.json.decode(place.read(LARGEST), type=kind)
    except FileNotFoundError:
        return {}
    except (OSError, msgspec.MsgspecError) as error:
        raise FileError(f"{place}: {error}") from None


def _length(value: float) -> str:
    return f"{1e3 * value:.3g} mm" if value >= 1e-5 else f"{value:.2g} m"
