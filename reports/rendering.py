"""Render the templates of pages and of drawings inside them, and write a page as one file."""

import math
from collections.abc import Iterable
from functools import cache
from inspect import isfunction
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ..harness.base.files import write_text
from .model import words
from .model.glossary import term

FOLDER = Path(__file__).parent
SORTED = 6  # digits of a number used to sort a table


@cache
def make_environment() -> Environment:
    """Return the template environment, which is made in the first call only.

    Values are escaped, a missing one is an error, and the functions of reports/model/words.py are known.
    """
    out = Environment(
        loader=FileSystemLoader(FOLDER / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    out.filters.update(px=lambda v: f"{v:.1f}", finite=math.isfinite)
    out.tests["known"] = lambda v: v == v  # not NaN
    out.globals.update(
        {k: f for k, f in vars(words).items() if isfunction(f)}, term=term, num=_format_cell, nan=math.nan
    )
    return out


def load_templates(names: Iterable[str]) -> None:
    """Compile templates of these names, for the processes that are forked later to inherit."""
    for name in set(names):
        make_environment().get_template(name)


def render(template: str, **values: Any) -> str:
    """Render the template of that name in ``templates/`` with ``values``; raise UndefinedError for a missing value."""
    return make_environment().get_template(template).render(values)


def write_file(path: Path, template: str, **values: Any) -> None:
    """Write a page as one file, charts included."""
    write_text(path, render(template, **values))


def _format_cell(value: float | None, show: Any = words.number) -> Markup:
    """Return an HTML table cell that shows a number by ``show`` and sorts by its value; NaN and None sort as empty."""
    v = math.nan if value is None else float(value)
    return Markup('<td class="n" data-v="{}">{}</td>').format("" if v != v else f"{v:.{SORTED}g}", show(v))
