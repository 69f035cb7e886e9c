"""Format numbers and statuses for readers: three digits, powers of ten, a mark and a word."""

import math
import re
from dataclasses import dataclass

SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
BELOW_CLOCK = "below the clock"  # a CPU time of 0: shorter than the clock's resolution
NONE = "–"  # the quantity does not exist
MARKS = {  # by status
    "success": ("✓", "good"),
    "inaccurate": ("≈", "inaccurate"),
    "wrong": ("✗", "wrong"),
    "refused": ("⊘", "refused"),
    "unfinished": ("…", "open"),
}

WORDS = {"unfinished": "not finished here"}


@dataclass(frozen=True)
class Mark:
    """The symbol, word and kind that show a status, so that colour is never alone."""

    symbol: str
    word: str
    kind: str  # class in the style sheet: good, inaccurate, wrong, refused, open, failed


def mark_status(status: str) -> Mark:
    """Return the mark of a status; an unknown status counts as a failure."""
    symbol, kind = MARKS.get(status, ("★", "failed"))
    return Mark(symbol, WORDS.get(status, status.replace("_", " ")), kind)


def number(value: float, digits: int = 3) -> str:
    """Format ``digits`` significant digits: ``0.00123``, below 0.001 and from 10⁵ ``1.23×10⁻⁵``, a dash for NaN."""
    if math.isnan(value):
        return NONE
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{abs(value):.{digits - 1}e}".split("e")
    power, sign = int(exponent), "−" if value < 0.0 else ""
    if -3 <= power < 5:
        return sign + (f"{abs(value):.{max(digits - 1 - power, 0)}f}")
    return f"{sign}{mantissa}×10{str(power).translate(SUPERSCRIPTS)}"


def format_decade(value: float) -> str:
    """Format a power of ten without a factor: ``0.001``, ``10⁻⁵``."""
    return number(value, 1).removeprefix("1×")


def format_count(value: float) -> str:
    """Format a count in groups of three digits."""
    return number(value) if not math.isfinite(value) else f"{round(value):,}".replace(",", "\u202f")


def format_signed(value: float) -> str:
    """Format a number with its sign."""
    return f"+{number(value)}" if value > 0.0 else number(value)


def time(value: float) -> str:
    """Format a simulated time without its unit and without trailing zeros."""
    return f"{value:.6g}" if math.isfinite(value) else number(value)


def format_cpu_time(value: float) -> str:
    """Format a CPU time without its unit."""
    return BELOW_CLOCK if value == 0.0 else number(value)


def seconds(value: float) -> str:
    """Format a CPU time with its unit: ``20.9 ms``, ``1.45 s``."""
    if math.isnan(value) or value == 0.0:
        return format_cpu_time(value)
    return f"{number(1e3 * value)} ms" if 0.0 < abs(value) < 0.1 else f"{number(value)} s"


def unit(text: str) -> str:
    """Format a unit with superscripts: ``kg m2/s`` as ``kg m²/s``."""
    return re.sub(r"(?<=[^\W\d_])[23]", lambda digit: digit[0].translate(SUPERSCRIPTS), text)


def plural(n: int, one: str, many: str = "") -> str:
    """Format a count with its noun: ``1 run``, ``2 runs``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def claim_success(wrong: int) -> str:
    """Return the verb for a number of false successes: ``report success and are wrong``."""
    return "reports success and is wrong" if wrong == 1 else "report success and are wrong"


def truncate(text: str, most: int) -> str:
    """Return the text as one line of at most ``most`` characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 1] + "…"


def join_words(items: list[str], most: int = 6) -> str:
    """Join items: ``a, b and c``; items beyond ``most`` are counted."""
    if len(items) > most:
        items = [*items[: most - 1], f"{len(items) - most + 1} more"]
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + f" and {items[-1]}" if items else ""
