"""Define the terms of this project in one sentence each, for tooltips, a page of the report and ``docs/glossary.md``.

``python -m mbsbench.reports.model.glossary`` prints the list for ``docs/glossary.md``; a test compares them.
"""

import sys
import textwrap
import tomllib
from collections.abc import Mapping
from pathlib import Path

from markupsafe import Markup, escape

WIDTH = 100  # characters of a line of a page
SOURCE = Path(__file__).parent.parent / "assets" / "glossary.toml"
GLOSSARY: Mapping[str, str] = tomllib.loads(SOURCE.read_text(encoding="utf-8"))


def term(name: str, shown: str = "") -> Markup:
    """Return ``shown`` (or the term itself) with its meaning as a tooltip, for templates."""
    if name not in GLOSSARY:
        return escape(shown or name)
    return Markup('<abbr title="{}">{}</abbr>').format(GLOSSARY[name], shown or name)


def format_markdown() -> str:
    """Return the list of terms for ``docs/glossary.md``, in Markdown."""
    entries = (f"- **{name}**: {text}" for name, text in GLOSSARY.items())
    return "".join(f"{textwrap.fill(e, WIDTH, subsequent_indent='  ', break_on_hyphens=False)}\n" for e in entries)


if __name__ == "__main__":
    sys.stdout.write(format_markdown())
