"""Read text tables as many tools write them: delimiters, decimal commas, titles, rows of units, Fortran's exponents.

The format is found from the rows of numbers: it is the pair of a delimiter and a decimal mark by which most lines are
numbers. Lines before them are titles, the header, and at most one row of units. OpenSim's files have lines up to
``endheader`` before that.
"""

import itertools
import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .conventions import is_unit

COMMENT = "#%"
SAMPLE = 200  # lines at either end from which the format and printed digits are read
NUMBER = re.compile(r"[+-]?(\d*)\.?(\d*)(?:[eE]([+-]?\d+))?$")
FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")
# pairs of delimiter and decimal mark, in the order in which they are tried
FORMATS = ((";", "."), ("\t", "."), (",", "."), ("", "."), (";", ","), ("\t", ","), ("", ","))  # "": blanks
MISSING = ("", "na", "n/a", "null", "none", "nan(ind)", "-nan(ind)", "-nan", "1.#qnan", "-1.#ind")
TINY = np.finfo(float).tiny  # keeps logarithms finite
SINGLE = 6e-8  # half a unit of the last place of float32


@dataclass(frozen=True)
class TextTable:
    """Columns by name, half a unit of their last printed digit, their units by name, and notes about the file."""

    columns: dict[str, np.ndarray]
    resolution: dict[str, np.ndarray]
    units: dict[str, str]
    angle: str = ""  # unit of all angles that the file gives elsewhere
    notes: tuple[str, ...] = ()


Lines = list[tuple[int, str]]  # lines with their numbers in the file


def parse_text_table(content: bytes, names: tuple[str, ...]) -> TextTable:
    """Return the table in the bytes of a text file; raise ValueError, which names the line, if it has none.

    ``names`` are those of the columns in a file without a header. A title that is left out is noted.
    """
    whole = [(k + 1, x) for k, x in enumerate(decode_text(content).splitlines()) if x.strip()]
    end = next((k for k, (_, x) in enumerate(whole) if x.strip().lower() == "endheader"), -1)
    angle = "deg" if any(re.sub(r"\s", "", x.lower()) == "indegrees=yes" for _, x in whole[: end + 1]) else ""
    whole = whole[end + 1 :]
    lines = [one for one in whole if one[1].lstrip()[0] not in COMMENT]
    if not lines:
        raise ValueError("it holds no rows")
    remarks = [x.strip().lstrip(COMMENT) for _, x in itertools.takewhile(lambda x: x[1].lstrip()[0] in COMMENT, whole)]
    delimiter, decimal, width = _find_format([x for _, x in (*lines[:SAMPLE], *lines[SAMPLE:][-SAMPLE:])])
    form = _Form(delimiter, decimal)
    numbered = (k for k, (_, x) in enumerate(lines) if width and _is_row(form.split_fields(x, width), width))
    first = next(numbered, len(lines))
    before, rows = lines[:first], lines[first:]
    header, units, titles = _read_header(form, before, width, remarks, names)
    if len(set(header)) < len(header):
        raise ValueError(f"column {next(h for h in header if header.count(h) > 1)!r} is there twice")
    if not rows:
        raise ValueError("it has a header and no rows")
    numbers = form.parse_rows(rows, len(header))
    sample = [form.split_fields(x, width) for _, x in (*rows[:SAMPLE], *rows[SAMPLE:][-SAMPLE:])]
    resolution = {h: measure_resolution(numbers[:, k], [row[k] for row in sample]) for k, h in enumerate(header)}
    notes = (f"not read: the title {titles[0]!r}",) if titles else ()
    return TextTable({h: numbers[:, k] for k, h in enumerate(header)}, resolution, units, angle, notes)


def decode_text(content: bytes) -> str:
    """Return the text of a file: UTF-16 or UTF-8 by its mark, else UTF-8 if valid, else the Windows character set."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


@dataclass(frozen=True)
class _Form:
    """The delimiter (blanks if empty) and decimal mark by which a line is split into numbers."""

    delimiter: str
    decimal: str

    def split_fields(self, line: str, width: int = 0) -> list[str]:
        """Return the fields of a line of numbers, without quotes, spelt as in Python.

        An empty field after the last delimiter, beyond ``width`` fields, is dropped.
        """
        parts = line.split(self.delimiter) if self.delimiter else line.split()
        out = [FORTRAN.sub("e", f.strip().strip("\"'").strip().replace(self.decimal, ".")) for f in parts]
        return out[:-1] if self.delimiter and len(out) > max(1, width) and not out[-1] else out

    def split_header(self, line: str) -> list[str]:
        """Return the fields of a line of the header, without quotes."""
        parts = line.split(self.delimiter) if self.delimiter else line.split()
        out = [f.strip().strip("\"'").strip() for f in parts]
        return out[:-1] if self.delimiter and len(out) > 1 and not out[-1] else out

    def parse_rows(self, rows: Lines, width: int) -> Float[np.ndarray, "nt n"]:
        """Return the numbers of all rows of ``width`` fields, NaN where they are missing.

        Raise ValueError, naming line and field, if one is no number.
        """
        text = [x for _, x in rows]
        unusual = any(c in x for x in (text[0], text[-1]) for c in "\"'dD")  # quotes, or exponents of Fortran
        if unusual or self.split_fields(text[0]) != self.split_header(text[0]):
            text = [",".join(self.split_fields(x, width)) for x in text]
        delimiter = "," if text[0] is not rows[0][1] else self.delimiter or None
        try:
            out = np.loadtxt(text, delimiter=delimiter, ndmin=2, comments=None)
        except ValueError:
            return np.array([self._parse_row(*row, width) for row in rows])
        if out.shape[1] != width:
            raise ValueError(f"{width} columns are named, the first row has {out.shape[1]}")
        return out

    def _parse_row(self, number: int, line: str, width: int) -> list[float]:
        """Return the numbers of a line, NaN where they are missing.

        Raise ValueError if it is not a row of ``width`` fields.
        """
        found = self.split_fields(line, width)
        if len(found) != width:
            raise ValueError(f"line {number} has {len(found)} fields, expected {width}")
        for k, text in enumerate(found):
            if not (is_number(text) or text.lower() in MISSING):
                raise ValueError(f"line {number}, field {k + 1}: expected a number (got {text[:40]!r})")
        return [np.nan if x.lower() in MISSING else float(x) for x in found]


def _find_format(sample: list[str]) -> tuple[str, str, int]:
    """Return delimiter, decimal mark and number of fields by which most lines of a sample are rows of numbers.

    The number of fields is 0 if no line is such a row.
    """
    best, most = ("", ".", 0), 0
    for delimiter, decimal in FORMATS:
        form = _Form(delimiter, decimal)
        widths = [len(f) for f in map(form.split_fields, sample) if _is_row(f, len(f))]
        if not widths:
            continue
        width = max(set(widths), key=widths.count)
        if widths.count(width) > most and (width > 1 or not best[2]):
            best, most = (delimiter, decimal, width), widths.count(width)
    return best


def _is_row(fields: list[str], width: int) -> bool:
    """Return whether there are ``width`` fields, all numbers or missing, and at least one number."""
    known = [is_number(f) for f in fields]
    return (
        len(fields) == width
        and any(known)
        and all(k or f.lower() in MISSING for k, f in zip(known, fields, strict=True))
    )


def _read_header(
    form: _Form, before: Lines, width: int, remarks: list[str], names: tuple[str, ...]
) -> tuple[list[str], dict[str, str], list[str]]:
    """Return names of columns, their units if a row has them, and titles, from the lines ``before`` the rows.

    ``remarks`` are comments, the last of which may be the header; ``names`` are given by the user. ``width`` is the
    number of fields of a row, 0 without rows. Raise ValueError if no names fit the rows.
    """
    if not before:
        if names:
            return list(names), {}, []
        # header in a comment, as written by numpy.savetxt and Exudyn
        if remarks and len(form.split_header(remarks[-1])) == width:
            return form.split_header(remarks[-1]), {}, []
        raise ValueError("it has no header: name its columns in order, --columns t,r_x,r_y,...")
    if not width:  # no rows
        found = next((d for d in (";", "\t", ",") if d in before[0][1]), "")
        return _Form(found, ".").split_header(before[0][1]), {}, []
    split = [form.split_header(x) for _, x in before]
    fitting = [k for k, f in enumerate(split) if len(f) == width]
    if not fitting:
        number, named = before[-1][0], split[-1]
        raise ValueError(f"{len(named)} columns are named (line {number}), the first row has {width}")
    k, units = fitting[-1], dict[str, str]()
    if len(fitting) > 1 and all(is_unit(u) for u in split[k]):
        k = fitting[-2]
        units = {h: u.strip("[]()") for h, u in zip(split[k], split[fitting[-1]], strict=True)}
    return split[k], units, [x.strip() for n, (_, x) in enumerate(before) if n not in fitting[-2:] or n < k]


def is_number(text: str) -> bool:
    """Return whether a field is a number, including infinity and NaN."""
    match = NUMBER.fullmatch(text)
    return bool(match and (match[1] or match[2])) or text.lower() in ("nan", "inf", "-inf", "+inf", "infinity")


def measure_resolution(values: Float[np.ndarray, " nt"], printed: list[str]) -> Float[np.ndarray, " nt"]:
    """Return half a unit of the last printed digit of each of ``values``.

    %f fixes the decimals of a column, %e and %g its digits; ``printed`` is a sample of the column's fields. Columns of
    whole numbers count as exact, with 0, for they are mostly zeros of a planar motion. Numbers that float32 represents
    to all printed digits are taken to be computed in it.
    """
    digits, decimals = 1, 0
    for match in filter(None, map(NUMBER.fullmatch, printed)):
        digits = max(digits, len((match[1] + match[2]).lstrip("0")))
        decimals = max(decimals, len(match[2]) - int(match[3] or 0))
    if not any("." in text or "e" in text.lower() for text in printed):
        return np.zeros(len(values))
    known = np.isfinite(values) & (values != 0.0)
    sizes = np.abs(np.where(known, values, 10.0 ** -(decimals + digits)))
    by_digits: np.ndarray = 10.0 ** (np.floor(np.log10(np.maximum(sizes, TINY))) - digits + 1)
    out: np.ndarray = 0.5 * np.maximum(by_digits, 10.0**-decimals) if digits < 17 else np.zeros(len(values))
    with np.errstate(over="ignore"):
        off = np.abs(values.astype(np.float32).astype(np.float64) - values)
    if digits > 7 and np.any(known) and np.all(off[known] <= 1.001 * out[known] + 1e-16 * sizes[known]):
        out = np.maximum(out, SINGLE * np.where(known, sizes, 0.0))
    return np.where(np.isfinite(values), out, 0.0)
