"""Texts about the figures, ``paper/captions.json``: numbers that do not exist are null."""

from pathlib import Path
from typing import Any

import msgspec

from ...harness.files import LARGEST, to_json
from ...harness.places import NotOwn, Place

FOLDER, FILE = "paper", "captions.json"


class CaptionRun(msgspec.Struct, frozen=True):
    """A run asked for; without a ``run_id`` the results do not have it."""

    role: str  # of its solver, in the paper
    solver: str
    asked: str  # its settings in words
    settings_id: str
    found: bool
    run_id: str = ""
    reasons: tuple[str, ...] = ()  # why it is no success
    status: str = ""
    t_reached_s: float | None = None
    t_end_s: float | None = None
    steps: float | None = None
    energy_start_J: float | None = None
    energy_drift_max_J: float | None = None
    energy_drift_end_J: float | None = None
    phi_max: float | None = None
    phi_dot_max: float | None = None
    position_error_max_m: float | None = None
    orientation_error_max_rad: float | None = None
    step_min_s: float | None = None
    step_max_s: float | None = None


COLUMNS = CaptionRun.__struct_fields__[CaptionRun.__struct_fields__.index("status") :]  # those of the record


class CaptionClaim(msgspec.Struct, frozen=True):
    """A claim on the figure and its verdicts, each with how many settings it holds in; empty where there are none."""

    id: str
    quote: str
    claim: str
    missing: str  # why it cannot be tested
    tests: tuple[tuple[str, str], ...]  # measured, band
    paper: tuple[str, str]  # at the settings that the paper prints
    beyond: tuple[str, str]


class Caption(msgspec.Struct, frozen=True):
    """All that is said about a figure."""

    number: int
    name: str
    label: str
    section: str
    title: str
    panels: tuple[str, ...]
    note: tuple[str, ...]
    runs: tuple[CaptionRun, ...]
    claims: tuple[CaptionClaim, ...]
    claims_published: bool  # the results are not judged: verdicts are the published ones
    files: tuple[str, ...]


class Captions(msgspec.Struct, frozen=True):
    """The file."""

    run: str
    commit: str
    figures: tuple[Caption, ...]


def read(folder: Path) -> tuple[Caption, ...]:
    """Those of the figures made from the results in ``folder``; none where the file is not of this shape."""
    try:
        return msgspec.json.decode((Place(folder) / FOLDER / FILE).read(LARGEST), type=Captions).figures
    except NotOwn:
        raise
    except (OSError, ValueError, RecursionError):
        return ()


def write(folder: Path, environment: Any, made: list[Caption], order: list[str]) -> None:
    """Those made now, and those of other figures that were made before."""
    new = {c.name for c in made}
    every = [*(c for c in read(folder) if c.name in order and c.name not in new), *made]
    figures = tuple(sorted(every, key=lambda c: order.index(c.name)))
    whole = Captions(str(environment.get("run") or folder.name), str(environment.get("commit", "")), figures)
    (Place(folder) / FOLDER / FILE).write(to_json(whole, indent=1))
