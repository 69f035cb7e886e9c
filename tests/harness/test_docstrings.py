"""Docstrings are sentences of a manual: functions begin with a verb in the imperative, no summary is a riddle.

The linter checks the form of a summary (D205, D400, D401, D415); these tests check what it does not see.
"""

import ast
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FINISHED = (
    "*.py",
    "checker/*.py",
    "cli/**/*.py",
    "docs/**/*.py",
    "harness/**/*.py",
    "problems/**/*.py",
    "reports/**/*.py",
    "solvers/**/*.py",
)
VERBS = """
    accept add advance allocate allow analyse animate append apply approach arrange assemble become begin build
    cache call carry change check choose close collect compare compile complete compute confine continue convert
    copy correct count couple create decide delete describe draw drive eliminate end ensure enter escape estimate
    evaluate examine expand explain express extend extrapolate factor factorise fill find fit flush fork format give
    group hang hinge hold import integrate interpolate invert iterate join judge keep kill label let limit list load
    lock make march mark measure merge mirror model move multiply name normalise note open order pack pair parse
    pass pick place plot prepare print project propose protect provide publish quantise raise rank read record
    redirect refuse register release remove rename render repeat replace report request reshape restart restore restrict
    return roll rotate round run scale score select send separate serve set shade shrink solve sort split start
    state step stop store substitute subtract sum summarise swing tabulate take throw try turn wait warn wrap write
    yield
    """
RIDDLES = re.compile(
    r"(?:As|At|Beside|Both in|By|Each with|For|From|Here|How|In|It|No|None|Of|On|One|Once|Only|So|The same|Then|There|"
    r"Those|To|Until|Up to|What|When|Where|Whether|Which|While|Who|Whose|Why|With|Without)\b"
)
QUOTED = re.compile(r"``.*?``", re.DOTALL)
DIALECT = re.compile(r"\b(?:told|owed|lent|(?<!-)handed|posing|apart from each other)\b")
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def list_docstrings(room: str) -> Iterator[tuple[str, Documented, str]]:
    """Yield the place, node and docstring of every documented module, class and function of a room."""
    for path in sorted(ROOT.glob(room)):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, Documented) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(ROOT)}:{node.body[0].lineno}", node, text


def list_comments(room: str) -> Iterator[tuple[str, str]]:
    """Yield the place and text of every comment of a room."""
    for path in sorted(ROOT.glob(room)):
        with path.open("rb") as file:
            for token in tokenize.tokenize(file.readline):
                if token.type == tokenize.COMMENT:
                    yield f"{path.relative_to(ROOT)}:{token.start[0]}", token.string


def is_property(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether a function is read like data, so that its docstring may be a noun phrase."""
    return any("property" in ast.unparse(d) for d in node.decorator_list)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("room", FINISHED)
def test_functions_begin_with_a_verb_in_the_imperative(room: str) -> None:
    """A verb says what a caller gets; the list of verbs grows only by real ones."""
    found = [
        f"{place}: {text.splitlines()[0]}"
        for place, node, text in list_docstrings(room)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not is_property(node)
        if text.split()[0].strip(".,;:").lower() not in VERBS.split()
    ]
    assert not found, "\n".join(found)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("room", FINISHED)
def test_no_docstring_begins_like_a_riddle(room: str) -> None:
    """A summary without a subject ("Of ...", "What ...", "The same; ...") cannot be read alone."""
    found = [f"{place}: {text.splitlines()[0]}" for place, _, text in list_docstrings(room) if RIDDLES.match(text)]
    assert not found, "\n".join(found)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("room", FINISHED)
def test_docstrings_and_comments_use_the_words_of_the_field(room: str) -> None:
    """Words that exist in this project alone tell a stranger nothing."""
    texts = [(place, text) for place, _, text in list_docstrings(room)] + list(list_comments(room))
    found = [f"{place}: {word[0]}" for place, text in texts if (word := DIALECT.search(QUOTED.sub("", text)))]
    assert not found, "\n".join(found)
