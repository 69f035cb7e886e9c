"""The terms of this project, one sentence each: tooltips and a page of the report, and ``docs/glossary.md``.

``python -m mbsbench.reports.model.glossary`` prints the list for ``docs/glossary.md``; a test compares.
"""

import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

from markupsafe import Markup, escape

SOURCE = Path(__file__).parent.parent / "assets" / "glossary.toml"
GLOSSARY: Mapping[str, str] = tomllib.loads(SOURCE.read_text(encoding="utf-8"))


def term(name: str, shown: str = "") -> Markup:
    """``shown`` (or the term itself) with its meaning as a tooltip, where it has one; for templates."""
    if name not in GLOSSARY:
        return escape(shown or name)
    return Markup('<abbr title="{}">{}</abbr>').format(GLOSSARY[name], shown or name)


def markdown() -> str:
    """The list of ``docs/glossary.md``."""
    return "".join(f"- **{name}**: {text}\n" for name, text in GLOSSARY.items())


if __name__ == "__main__":
    sys.stdout.write(markdown())
