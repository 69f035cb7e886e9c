"""Build the article from one source, as HTML and LaTeX; where pdflatex exists, as PDF.

    python docs/article/build_article.py [FOLDER]      # make article

Every number in ``article.j2`` is a placeholder: ``{{ name }}`` of ``article_data.py``, whose values come from published
results. The build fails with one line on a digit or number word in the prose, a literal in a placeholder, a name, table
or figure without a source, a value that is not finite, and on ``{% assert ... %}`` that does not hold.
"""

import math
import re
import shutil
import subprocess
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import article_data as data  # type: ignore[import-not-found]  # beside this file
import jinja2
from article_data import Fault
from article_marks import EQUATION, as_html, as_latex  # type: ignore[import-not-found]
from jinja2 import nodes
from jinja2.ext import Extension

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.reports.model.words import number
from mbsbench.reports.plots.paper import save_figure

HERE = Path(__file__).resolve().parent
SOURCE = HERE / "article.j2"
PLACES = re.compile(
    r"\b(?:Sect|Fig|Eq|Ref)s?\. \(?\d+(?:\.\d+)*[a-f]?\)?(?:(?:, | and | to )\(?\d+(?:\.\d+)*[a-f]?\)?)*"
)
NAMES_WITH_DIGITS = ("ODE-45", "four-bar", "index 1", "index 3", "index-1", "2022")  # methods, the year of the paper
WORDS = re.compile(
    r"\b(?:three|four|five|six|seven|eight|nine|ten|eleven|twelve|\w+teen|twenty|thirty|forty|fifty|"
    r"dozen|hundred|thousand|million|per ?cent|thrice)s?\b",
    re.IGNORECASE,
)
JINJA = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}", re.DOTALL)
CODE = re.compile(r"`[a-z]\w*`")  # names of solvers and programs
INDEX = re.compile(r"[_^]\{?-?\d+\}?")
LATEX = dict(
    zip(
        (
            "block_start_string",
            "block_end_string",
            "variable_start_string",
            "variable_end_string",
            "comment_start_string",
        ),
        ("<%", "%>", "<<", ">>", "<#"),
        strict=True,
    )
)
RUN_LIMIT = 300  # [s] of one pass of pdflatex


class Assert(Extension):
    """Fail the build where ``{% assert claim("x").verdict == "not reproduced" %}`` does not hold."""

    tags = {"assert"}  # noqa: RUF012  # as the base class has it

    def parse(self, parser: Any) -> nodes.Node:
        """Return a call that fails where the condition does not hold."""
        line = next(parser.stream).lineno
        call = self.call_method("_check", [parser.parse_expression()], lineno=line)
        return nodes.CallBlock(call, [], [], []).set_lineno(line)

    def _check(self, holds: Any, caller: Any) -> str:
        if not holds:
            raise Fault("the results contradict the sentence: this condition does not hold")
        return ""


def show(value: Any) -> str:
    """Return a value as the text has it; raise Fault for one without a finite number."""
    if isinstance(value, jinja2.Undefined):
        raise Fault(f"{value._undefined_name!r} is not in published results")
    if value is None:
        raise Fault("a placeholder's value is None")
    if isinstance(value, float) and not math.isfinite(value):
        raise Fault(f"a placeholder's number is {value}")
    if isinstance(value, float):
        return number(value)
    return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) and value >= 10_000 else str(value)


def environment() -> jinja2.Environment:
    """Return an environment with the names of the data as placeholders, none undefined."""
    found = jinja2.Environment(
        undefined=jinja2.StrictUndefined, finalize=show, extensions=[Assert], autoescape=False, trim_blocks=True
    )
    found.globals = dict(data.NAMES)
    found.filters["measured"] = data.format_measured
    return found


def check_source(text: str) -> None:
    """Check that no number is typed: neither in the prose, nor in an equation, nor as a literal in a placeholder."""

    def blank(m: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " ", m[0])

    prose = JINJA.sub(blank, text)
    for m in EQUATION.finditer(prose):
        if re.search(r"\d", INDEX.sub("", m[0])):
            raise at(prose.count("\n", 0, m.start()) + 1, f"the equation {m[0]} holds a typed number")
    prose = CODE.sub(blank, PLACES.sub(blank, EQUATION.sub(blank, prose)))
    for name in NAMES_WITH_DIGITS:
        prose = prose.replace(name, " " * len(name))
    for m in sorted([*re.finditer(r"\S*\d\S*", prose), *WORDS.finditer(prose)], key=lambda m: m.start())[:1]:
        raise at(prose.count("\n", 0, m.start()) + 1, f"{m[0]!r} is typed and has no source; use a placeholder")
    try:
        tree = environment().parse(text)
    except jinja2.TemplateSyntaxError as error:
        raise at(error.lineno, f"{error.message}") from None
    for output in tree.find_all(nodes.Output):
        for part in output.nodes:
            if isinstance(part, nodes.TemplateData):
                continue
            wrapped = nodes.Output([part])  # ``find_all`` searches below a node: wrapped, the part itself is found too
            places = {id(c) for n in wrapped.find_all(nodes.Getitem) for c in n.find_all(nodes.Const)}
            names = {
                id(c) for n in wrapped.find_all(nodes.Call) for c in n.find_all(nodes.Const) if isinstance(c.value, str)
            }
            for const in wrapped.find_all(nodes.Const):
                if id(const) not in places | names:
                    raise at(part.lineno, f"the placeholder types {const.value!r} instead of naming a source")
    for other in tree.find_all((nodes.Assign, nodes.For)):
        raise at(other.lineno, "no variable may hold a number; use a placeholder")


def at(line: int, words: str) -> Fault:
    """Return a fault with its line in the source."""
    return Fault(f"{SOURCE.name}:{line}: {words}")


def fill(text: str) -> str:
    """Return the text with its numbers."""
    check_source(text)
    try:
        return environment().from_string(text).render()
    except (Fault, jinja2.UndefinedError, AttributeError, TypeError, ValueError, KeyError) as error:
        lines = [f.lineno or 1 for f in traceback.extract_tb(error.__traceback__) if f.filename == "<template>"]
        raise at(lines[-1] if lines else 1, str(error)) from None


@dataclass(frozen=True)
class Block:
    """Hold a paragraph, heading, table or figure; ``name`` is that of a table or figure, whose text is the caption."""

    kind: str
    text: str
    name: str = ""


def blocks(text: str) -> list[Block]:
    """Split the filled text into its parts at blank lines."""
    out = []
    for part in filter(None, (p.strip() for p in re.split(r"\n\s*\n", text))):
        mark, _, rest = part.partition(" ")
        if mark in ("#", "##"):
            out.append(Block({"#": "title", "##": "section"}[mark], rest))
        elif mark in ("@table", "@figure"):
            name, _, caption = rest.partition("\n")
            if name not in {"@table": data.TABLES, "@figure": data.FIGURES}[mark]:
                raise Fault(f"{SOURCE.name}: no {mark[1:]} {name!r} is drawn from published results")
            out.append(Block(mark[1:], caption, name))
        else:
            out.append(Block("text", part))
    return out


def render(found: list[Block], template: str, marks: Callable[[str], str], **signs: str) -> str:
    """Return the article in the format of a template; ``signs`` are those of its placeholders."""
    page = jinja2.Environment(trim_blocks=True, autoescape=False, **signs)  # type: ignore[arg-type]  # marks escape
    page.filters["marks"] = marks
    text = (HERE / template).read_text(encoding="utf-8")
    return page.from_string(text).render(blocks=found, tables=data.TABLES)


def build(folder: Path) -> list[Path]:
    """Write the article into ``folder``; the PDF where pdflatex is installed."""
    folder.mkdir(parents=True, exist_ok=True)
    found = blocks(fill(SOURCE.read_text(encoding="utf-8")))
    for block in found:
        if block.kind == "figure":
            save_figure(data.FIGURES[block.name], ConfinedPath(folder), block.name, ("pdf", "svg"))
    out = [folder / "article.html", folder / "article.tex"]
    out[0].write_text(render(found, "html.j2", as_html), encoding="utf-8")
    out[1].write_text(render(found, "latex.j2", as_latex, **LATEX), encoding="utf-8")
    return [*out, compile_latex(out[1])] if shutil.which("pdflatex") else out


def compile_latex(path: Path) -> Path:
    """Return the path of the compiled PDF."""
    line = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", path.name]
    done = subprocess.run(
        line, cwd=path.parent, capture_output=True, text=True, errors="replace", timeout=RUN_LIMIT, check=False
    )
    if done.returncode:
        raise Fault(f"pdflatex: {next((w for w in done.stdout.splitlines() if w.startswith('!')), 'it failed')}")
    return path.with_suffix(".pdf")


if __name__ == "__main__":
    try:
        made = build(Path(sys.argv[1] if len(sys.argv) > 1 else "results/local/article"))
        sys.stdout.write("".join(f"{path}\n" for path in made))
    except Fault as fault:
        sys.exit(f"error: {fault}")
