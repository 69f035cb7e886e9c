"""Write the table of docs/questions.md from docs/questions.toml: ``python docs/list_questions.py``."""

import re
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PAGE, DATA = HERE / "questions.md", HERE / "questions.toml"
TABLE = re.compile(r"(?<=<!-- made from questions\.toml by list_questions\.py -->\n).*(?=<!-- end -->)", re.DOTALL)
FIGURES = {"energy": r"energy drift +(\S+) J", "phi": r"\|phi_dot\| +(\S+) m", "error": r"^error +(\S+) m"}


def read_questions() -> list[dict[str, Any]]:
    """Return all questions in the order of the page."""
    return list(tomllib.loads(DATA.read_text(encoding="utf-8"))["question"])


def read_figure(question: dict[str, Any], printed: str) -> float:
    """Return the number that answers a question from the output of its command; raise ValueError if it is not found."""
    found = re.search(FIGURES.get(question["figure"], question["figure"]), printed, re.MULTILINE)
    if found is None:
        raise ValueError(f"{question['command']}: expected {question['figure']} in:\n{printed}")
    return float(found[1])


def read_stated(question: dict[str, Any]) -> tuple[float, float]:
    """Return the number stated in a question's answer, and half a unit of its last digit."""
    text = question["value"].split()[0]
    mantissa, _, power = text.partition("e")
    digits = len(mantissa.partition(".")[2])
    return float(text), 0.5 * 10.0 ** (int(power or 0) - digits)


def table() -> str:
    """Return the table of questions, with threads, answer and command of each, or what is missing to answer it."""
    rows = ["| question | answer | command |", "|---|---|---|"]
    for q in read_questions():
        links = ", ".join(f"[{t}](https://github.com/{t.replace('#', '/issues/')})" for t in q["threads"])
        answer = f"**Missing:** {q['missing']}." if "missing" in q else q["answer"].replace("{}", f"**{q['value']}**")
        command = f"`{q['command'].strip()}`" if "command" in q else ""
        rows.append(f"| {q['ask']} {links} | {answer} | {command} |".replace("|phi|", "phi"))
    answered = sum("command" in q for q in read_questions())
    return "\n".join([f"{answered} of {len(rows) - 2} are answered.", "", *rows]) + "\n"


if __name__ == "__main__":
    PAGE.write_text(TABLE.sub(lambda _: table(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
