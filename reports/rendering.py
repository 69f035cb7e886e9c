"""Templates of pages and of drawings inside them, and one page as a file of its own."""

import math
from functools import cache
from inspect import isfunction
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ..harness.files import write_text
from .model import words
from .model.glossary import term

FOLDER = Path(__file__).parent
SORTED = 6  # digits of a number that a table sorts by


@cache
def environment() -> Environment:
    """Text is escaped; templates know the functions of reports/model/words.py."""
    out = Environment(loader=FileSystemLoader(FOLDER / "templates"), autoescape=True, undefined=StrictUndefined,
                      trim_blocks=True, lstrip_blocks=True)  # fmt: skip
    out.filters.update(px=lambda v: f"{v:.1f}", finite=math.isfinite)
    out.tests["known"] = lambda v: v == v  # a number
    out.globals.update({k: f for k, f in vars(words).items() if isfunction(f)}, term=term, num=_entry, nan=math.nan)
    return out


def render(template: str, **values: Any) -> str:
    """A template with ``values``."""
    return environment().get_template(template).render(values)


def write_file(path: Path, template: str, **values: Any) -> None:
    """Write a page that is one file, charts included."""
    write_text(path, render(template, **values))


def _entry(value: float | None, show: Any = words.number) -> Markup:
    """A number as a table's entry that sorts by its value, with as many digits as sorting needs."""
    v = math.nan if value is None else float(value)
    return Markup('<td class="n" data-v="{}">{}</td>').format("" if v != v else f"{v:.{SORTED}g}", show(v))
