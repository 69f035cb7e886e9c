"""Define the record of one run: its settings, how it ended, its measurements and its cost, all that reports see.

A record is flat: every field is a column of ``runs.parquet``, with its unit at the end of its name. The columns are
declared in ``harness/columns/declared/``, each with its meaning and, if it is measured, its function. Options, counters
and invariants, which differ between problems and solvers, are JSON strings in files; a record has them as typed
properties, and nothing else parses them.
"""

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from ..base import files
from ..base.files import FileError
from ..base.shapes import Shape, convert_shape
from ..base.text import find_unaccepted
from ..columns.declared.origin import SCHEMA
from ..columns.declaring import Declaration, read_declaration
from ..columns.record import Columns
from ..mechanics.types import Reason

T = TypeVar("T")

ESSENTIAL = ("run_id", "case", "problem", "solver", "status")  # other columns may be newer than the file


@dataclass(frozen=True)
class Deviation:
    """The largest and last value of a named error or drift with its unit; of an invariant also its start."""

    max: float
    end: float
    start: float
    unit: str


@dataclass(frozen=True, repr=False)
class RunRecord(Columns):
    """The record of a run; NaN or an empty string if a quantity does not exist, e.g. an error without a reference."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The parameters of the problem that differ from its defaults, by name."""
        return parse_settings(self.problem_parameters)

    @property
    def options(self) -> Mapping[str, Any]:
        """The options of the solver that differ from its defaults, by name."""
        return parse_settings(self.solver_options)

    @property
    def counts(self) -> Mapping[str, int]:
        """All counters of the solver, by its own names."""
        return _parse_object(self.counters, "column counters")

    @property
    def note_lines(self) -> tuple[str, ...]:
        """The notes of the solver, of what was measured, and of what is not judged."""
        return _parse_notes(self.notes)

    @property
    def observables(self) -> Mapping[str, Deviation]:
        """The distance of each observable from that of the reference, by its name."""
        return _parse_deviations(self.observable_errors, "column observable_errors")

    @property
    def invariants(self) -> Mapping[str, Deviation]:
        """The departure of each invariant from its start, by its name."""
        return _parse_deviations(self.invariant_drifts, "column invariant_drifts")

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """The laws that the motion breaks, and the limits beyond which it is inaccurate."""
        return parse_reasons(self.wrong_because)

    def __repr__(self) -> str:
        words = f"{self.status or 'no status'}{f', {self.steps} steps' if self.steps else ''}; vars() has all columns"
        return f"<RunRecord {self.case or 'without a case'}: {words}>"


COLUMNS: tuple[dataclasses.Field, ...] = dataclasses.fields(RunRecord)
DECLARED: Mapping[str, Declaration] = {c.name: read_declaration(c) for c in COLUMNS}
KEPT = 4096  # texts of JSON columns that stay parsed; a record holds columns alone, as other processes and files do
# types in JSON columns: a count, and a number that may not be finite
Counted = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1, description="a whole number of 64 bits")]
Number = float | Literal["nan", "inf", "-inf"]


class Extent(Shape, frozen=True):
    """A ``Deviation`` as files have it."""

    max: Number = "nan"
    end: Number = "nan"
    start: Number = "nan"
    unit: str = ""


JSON_COLUMNS: Mapping[str, Any] = {  # type of the content of each column that is JSON
    "problem_parameters": dict[str, Any],
    "solver_options": dict[str, Any],
    "counters": dict[str, Counted],
    "observable_errors": dict[str, Extent],
    "invariant_drifts": dict[str, Extent],
    "notes": list[str],
}


def parse_settings(text: str) -> Mapping[str, Any]:
    """Return parameters or options by name from the JSON text of their column; parsed texts are cached.

    Raise FileError if the text is no JSON object.
    """
    return _parse_object(text, "settings")


def is_literal(record: RunRecord) -> bool:
    """Return whether the run starts exactly as printed, although that opens joints (``Problem.literal_start``)."""
    return bool(record.parameters.get("literal_start"))


def find_limit(record: RunRecord, name: str) -> float:
    """Return the limit that the column ``name`` declares for the number of a record; NaN if it has none."""
    limit = DECLARED[name].limit
    return math.nan if limit is None else float(limit(record))


def find_cpu_range(record: RunRecord) -> tuple[float, float]:
    """Return the lower and upper quartile of the repeats' CPU times [s]; for older records the extremes."""
    if math.isnan(record.cpu_q1_s):
        return record.cpu_min_s, record.cpu_max_s
    return record.cpu_q1_s, record.cpu_q3_s


def format_record(record: RunRecord) -> str:
    """Format the record as strict JSON; numbers that are not finite become ``"nan"``, ``"inf"``, ``"-inf"``."""
    return files.to_json({c.name: files.encode_nonfinite(getattr(record, c.name)) for c in COLUMNS}, indent=1)


def parse_record_json(text: str) -> RunRecord:
    """Return the record in the JSON ``text``, with all its columns validated, also the content of those that are JSON.

    Raise FileError if it is not the record of a run, has another schema, or a column is missing or invalid.
    """
    plain = files.parse_json(text, "record")
    if not isinstance(plain, dict) or "schema" not in plain or "run_id" not in plain:
        raise FileError("not a record of a run")
    if plain["schema"] != SCHEMA:
        raise FileError(f"schema {plain['schema']!r}, expected {SCHEMA}")
    for name in ESSENTIAL:
        if name not in plain:
            raise FileError(f"column {name} is missing")
    record = _convert(plain, RunRecord, "record")
    long = [c.name for c in COLUMNS if c.type is int and not -(2**63) <= getattr(record, c.name) < 2**63]
    if long:
        raise FileError(f"column {long[0]} holds an integer of more than 64 bits")
    for c in COLUMNS:
        if c.type is str and c.name != "message" and (found := find_unaccepted(getattr(record, c.name))):
            raise FileError(f"column {c.name} holds {found}")
    for name, kind in JSON_COLUMNS.items():
        where = f"column {name}"
        convert_shape(files.parse_json(getattr(record, name), where), kind, where)
    parse_reasons(record.wrong_because)
    return record


def format_notes(notes: Iterable[str]) -> str:
    """Format notes as the text of the column ``notes``, a JSON list."""
    return json.dumps(list(notes))


def format_reasons(reasons: Iterable[Reason]) -> str:
    """Format reasons as the text of the column ``wrong_because``, a JSON list."""
    return files.to_json([{k: files.encode_nonfinite(v) for k, v in vars(r).items()} for r in reasons])


@lru_cache(KEPT)
def parse_reasons(wrong_because: str) -> tuple[Reason, ...]:
    """Return the reasons in the text of the column ``wrong_because``; raise FileError if it is invalid."""
    where = "column wrong_because"
    found = convert_shape(files.parse_json(wrong_because, where), list[dict[str, Any]], where)
    return tuple(_convert(plain, Reason, where) for plain in found)


@lru_cache(KEPT)
def _parse_notes(text: str) -> tuple[str, ...]:
    """Return the notes in the text of their column; raise FileError if it is invalid."""
    return tuple(convert_shape(files.parse_json(text or "[]", "column notes"), list[str], "column notes"))


@lru_cache(KEPT)
def _parse_object(text: str, where: str) -> Mapping[str, Any]:
    """Return the JSON object in ``text``, read-only; raise FileError, which names ``where``, if it is none."""
    return MappingProxyType(convert_shape(files.parse_json(text, where), dict[str, Any], where))


@lru_cache(KEPT)
def _parse_deviations(text: str, where: str) -> Mapping[str, Deviation]:
    """Return the deviations in the text of a column by name; raise FileError, which names ``where``, if invalid."""
    found = convert_shape(files.parse_json(text, where), dict[str, Extent], where)
    return MappingProxyType(
        {name: Deviation(float(e.max), float(e.end), float(e.start), e.unit) for name, e in found.items()}
    )


def _convert(plain: Mapping[str, Any], kind: type[T], where: str) -> T:
    """Convert the values ``plain`` to the dataclass ``kind``; the texts "nan", "inf" and "-inf" become numbers.

    Raise FileError, which names ``where``, if they do not fit.
    """
    floats = {f.name for f in dataclasses.fields(kind) if f.type is float}  # type: ignore[arg-type]
    given = {k: float(v) if k in floats and v in ("nan", "inf", "-inf") else v for k, v in plain.items()}
    return convert_shape(given, kind, where)
