"""What `make test-versions` reads of pip and pytest, and what it prints; the environments themselves are its own."""

from subprocess import CompletedProcess

import pytest
from packaging.requirements import Requirement

from mbsbench.tests import versions
from mbsbench.tests.versions import Allowed, Tried


@pytest.fixture
def index(monkeypatch):
    """PyPI has these versions, the newest first, one of them named as no tool does any more."""
    said = "thing (2.0.1)\nAvailable versions: 2.0.1, 1.10.0, 1.9.2, 1.9.0, 0.4.src\n"
    monkeypatch.setattr(versions, "_run", lambda *words: CompletedProcess(words, 0, said, ""))


@pytest.mark.parametrize(("specifier", "ends"), [(">=1.9", ("1.9.0", "2.0.1")), (">=1.9.1,<2", ("1.9.2", "1.10.0"))])
def test_both_ends_of_what_is_allowed_are_found(specifier, ends, index):
    assert versions.find_allowed(Requirement(f"thing{specifier}"))[1:] == ends


def test_a_bound_that_no_version_meets_is_named(index):
    with pytest.raises(SystemExit, match="thing>=3"):
        versions.find_allowed(Requirement("thing>=3"))


def test_requirements_of_this_machine_without_checkers():
    project = {
        "dependencies": ["numpy>=2", "other>=1; sys_platform == 'none'"],
        "optional-dependencies": {"dev": ["mypy>=1", "pytest>=8"]},
    }
    assert [r.name for r in versions.read_requirements(project)] == ["numpy", "pytest"]


@pytest.mark.parametrize(
    ("code", "said", "listed"),
    [
        (0, "3 passed", []),
        (1, "FAILED tests/a.py::b - x\nERROR tests/c.py", ["tests/a.py::b - x", "tests/c.py"]),
        (-11, "..", ["pytest ended with -11: .."]),
    ],
)
def test_failed_tests_and_a_crash_are_listed(code, said, listed):
    assert versions.list_failed_tests(CompletedProcess((), code, said, "")) == listed


@pytest.mark.parametrize(("broken", "code"), [([], 0), (["rattle: diverged"], 1)])
def test_the_table_says_what_was_tried_and_what_broke(broken, code, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(versions, "PLACE", tmp_path / "versions")
    monkeypatch.setattr(versions, "read_requirements", lambda project: [Requirement("numba>=0.1")])
    monkeypatch.setattr(versions, "find_allowed", lambda one: Allowed(one, "0.1.0", "9.2"))
    found = {"oldest": Tried({"numba": "0.1.0"}, []), "newest": Tried({"numba": "9.1"}, broken)}
    monkeypatch.setattr(versions, "try_environment", lambda place, wanted, tests: found[place.name])
    assert versions.main(()) == code
    said = capsys.readouterr().out
    assert "numba>=0.1" in said and "0.1.0 *" in said and "9.1, PyPI has 9.2 *" in said
    assert all(f"newest: {len(broken) or 'nothing'} broke" in said and line in said for line in (*broken, ""))
