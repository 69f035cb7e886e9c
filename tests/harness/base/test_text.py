"""One door for text: typography of any script passes; what a terminal would obey, or nobody sees, does not."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.base.text import check_text, escape_text, find_unaccepted
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.results import store

ACCEPTED = (
    "Sect.\u00a05.1",
    "ODE\u202fGC",
    "multi\u00adbody",
    "jambe gauche é",
    "e\u0301",
    "左脚",
    "αβ′",
    "½ m²",
    "a‐b—c",
    "🙂",
)
REFUSED = {
    "a\tb": "U+0009 (tab)",
    "a\nb": "U+000A (newline)",
    "a\x1b[31m": "U+001B (escape)",
    "a\x00": "U+0000",
    "a\u200bb": "U+200B",
    "a\u200e": "U+200E",
    "a\u202eb": "U+202E",
    "a\u2066": "U+2066",
    "\ufeffa": "U+FEFF",
    "a\u0085": "U+0085",
    "a\u2028b": "U+2028",
}
GROUP = 'problem = "spherical_pendulum"\nparameters = {{ t_end = 0.5 }}\nsolver = "rattle"\ndt = 0.01\nlabel = "{}"\n'
PLUGIN = '''
from dataclasses import dataclass, replace
from typing import ClassVar
from mbsbench import make_problem, problem, solver
from mbsbench.harness.catalogue.registry import make_solver

@solver("named")
@dataclass(frozen=True)
class Named:
    """RATTLE under another name."""
    control: ClassVar[str] = "dt"
    paper_label: ClassVar[str] = "ODE-GC\\u00a0(2)"
    order: ClassVar[float] = 2.0
    def refuses(self, problem, control): return None
    def solve(self, problem, control):
        found = make_solver("rattle").solve(problem, control)
        return replace(found, message="a\\u202eb\\x1b[31m", notes=("c\\u200bd",), counters={{"e\\u2066": 1}})

@problem("there")
def there():
    """A pendulum of another section."""
    return replace(make_problem("spherical_pendulum", {{"t_end": 0.5}}), name="there", section="Sect.\\u00a05.1{}")
'''


@pytest.mark.parametrize("text", ACCEPTED)
def test_typography_of_any_script_passes(text: str) -> None:
    """In names, labels, sections and units; a terminal shows it as it is."""
    check_text("name", text)
    assert escape_text(text) == text


@pytest.mark.parametrize(("text", "found"), REFUSED.items())
def test_what_is_obeyed_or_not_seen_is_refused_and_escaped(text: str, found: str) -> None:
    """The message names it."""
    with pytest.raises(ValueError, match="name must not contain U") as caught:
        check_text("name", text)
    assert found in str(caught.value)
    escaped = escape_text(text)
    assert find_unaccepted(escaped.replace("\t", "").replace("\n", "")) == ""


@pytest.mark.sampled(0)
def test_a_suite_with_a_no_break_space_runs_and_is_read_back(tmp_path: Path, capsys) -> None:
    """Label, section and the paper's name of a solver; what a solver says is escaped."""
    suite, plugin, out = tmp_path / "s.toml", tmp_path / "p.py", tmp_path / "out"
    plugin.write_text(PLUGIN.format(""))
    text = GROUP.format("cas\u00a01").replace('"spherical_pendulum"\nparameters = { t_end = 0.5 }', '"there"')
    suite.write_text(f'plugins = ["p.py"]\n[[runs]]\n{text.replace("rattle", "named")}', encoding="utf-8")
    assert main(["run", str(suite), "--out", str(out)]) == 0
    loaded = store.load(out)
    assert not loaded.unreadable
    (r,) = loaded.records
    assert (r.label, r.section, r.paper_label) == ("cas\u00a01", "Sect.\u00a05.1", "ODE-GC\u00a0(2)")
    assert (r.status, r.message) == ("success", "a\\u202eb\\x1b[31m")
    assert "c\\\\u200bd" in r.notes and r.counters == '{"e\\u2066": 1}'
    capsys.readouterr()
    assert main(["run", str(suite), "--out", str(out), "--resume"]) == 0
    assert "1 already done" in capsys.readouterr().err


def test_control_characters_are_refused_at_the_declaration(tmp_path: Path) -> None:
    """Before anything runs: of suites, problems, solvers, bodies, joints and units."""
    with pytest.raises(FileError, match=r"runs 1: label must not contain U\+0009 \(tab\)"):
        parse_suite("[[runs]]\n" + GROUP.format("a\\tb"), "s", "s")
    problem = registry.make_problem("spherical_pendulum", {})
    with pytest.raises(ValueError, match=r"section must not contain U\+000A"):
        dataclasses.replace(problem, section="a\nb")
    with pytest.raises(ValueError, match=r"name of body must not contain U\+001B \(escape\)"):
        assemble([RigidBody(1.0, np.eye(3), name="a\x1b[31m")])
    odd = dataclasses.replace(problem.observables[0], unit="m\u200b")
    with pytest.raises(ValueError, match=r"unit of observable .* must not contain U\+200B"):
        dataclasses.replace(problem, observables=(odd,))
