"""``make release`` names what lags behind, each in a line that says what to do."""

import re
import subprocess
import sys

import pytest

from mbsbench.harness.results.environment import ROOT

pytestmark = pytest.mark.beyond_core


@pytest.fixture(scope="module")
def release():
    sys.path.insert(0, str(ROOT / "docs"))
    import release

    sys.path.pop(0)
    return release


NAMES = '_HOMES = {{"api": ("load", {})}}\n'
FILES = {
    "pyproject.toml": '[project]\nversion = "0.2.0"\ndependencies = ["numpy>=2.1"]\n[project.optional-dependencies]\n'
    "dev = []\nengines = []\nformats = []\ndocs = []\ncluster = []\n",
    "CITATION.cff": "cff-version: 1.2.0\nversion: 0.2.0\n",
    "CHANGELOG.md": "# Changelog\n\n## 0.2.0 (2027-01-02)\n\n## 0.1.0 (2026-11-23)\n",
    "__init__.py": NAMES.format('"solve"'),
    **{f"locks/requirements{x}.lock": "numpy==2.3.0 \\\n" for x in ("", "-engines", "-formats", "-docs", "-cluster")},
}


def git(root, *words):
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    subprocess.run(("git", *who, *words), cwd=root, check=True, capture_output=True)


@pytest.fixture
def tree(tmp_path):
    """A tree that is ready: 0.1.0 is tagged, 0.2.0 follows."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    for words in (("init", "-q"), ("add", "."), ("commit", "-qm", "0.1.0"), ("tag", "v0.1.0")):
        git(tmp_path, *words)
    return tmp_path


def change(tree, name, old, new):
    text = (tree / name).read_text()
    assert old in text
    (tree / name).write_text(text.replace(old, new))


def test_a_tree_that_is_ready_passes(release, tree):
    for check in (release.check_versions, release.check_tree, release.check_locks, release.check_contract):
        assert list(check(tree)) == []


@pytest.mark.parametrize(
    ("name", "old", "new", "check", "words"),
    [
        ("CITATION.cff", "0.2.0", "0.1.0", "versions", r"expected version: 0.2.0 (got 0.1.0)"),
        (
            "CHANGELOG.md",
            "0.2.0 (2027-01-02)",
            "Unreleased",
            "versions",
            "expected '## 0.2.0 (YYYY-MM-DD)' as its first",
        ),
        (
            "CHANGELOG.md",
            "## 0.2.0",
            "## Unreleased\n\n## 0.2.0",
            "versions",
            "'## Unreleased' stands above 0.2.0: raise",
        ),
        ("__init__.py", "solve", "answer", "tree", "1 files are not committed, __init__.py first"),
        ("locks/requirements.lock", "2.3.0", "2.0.1", "locks", "requirements.lock: expected numpy>=2.1 (got 2.0.1)"),
        ("locks/requirements.lock", "numpy", "other", "locks", "expected numpy>=2.1 (got none)"),
    ],
)
def test_what_lags_behind_is_said_in_a_line(release, tree, name, old, new, check, words):
    change(tree, name, old, new)
    (line,) = getattr(release, f"check_{check}")(tree)
    assert words in line and "\n" not in line


def test_a_tag_that_is_taken_is_refused(release, tree):
    git(tree, "tag", "v0.2.0")
    (line,) = release.check_versions(tree)
    assert line.startswith("tag v0.2.0 exists: raise version")


def test_a_public_name_goes_with_the_second_number_alone(release, tree):
    """Before 1.0; mends keep them."""
    change(tree, "__init__.py", "solve", "answer")
    assert not list(release.check_contract(tree))
    change(tree, "pyproject.toml", "0.2.0", "0.1.1")
    (line,) = release.check_contract(tree)
    assert "names of v0.1.0 are gone, solve: raise the second number" in line


def test_locks_and_the_page_of_formats_are_those_of_the_code(release):
    """Here and now, so that a number raised in the code is raised in the policy, too."""
    assert not list(release.check_locks(ROOT))
    assert not list(release.check_formats(ROOT))
    assert "solve" in release.read_public_names((ROOT / "__init__.py").read_text(encoding="utf-8"))


def test_a_format_that_rose_alone_is_named(release, monkeypatch):
    monkeypatch.setitem(release.NUMBERS, "bundle", (6,))
    (line,) = release.check_formats(ROOT)
    assert "expected bundle (6,) (got (5,))" in line


def test_the_lab_is_imported_by_commands_and_pages_alone():
    """What the table of owners says of it: core can be kept without it."""
    page = (ROOT / "docs" / "releasing.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| \*\*lab\*\* .*", page, re.MULTILINE)
    lab = re.findall(r"`harness/(\w+)/`", row)
    core = [p for folder in ("harness", "problems", "solvers") for p in (ROOT / folder).rglob("*.py")]
    core = [p for p in core if p.relative_to(ROOT).parts[1] not in lab]
    names = re.compile(rf"from (?:\.\.+|\.+harness\.|mbsbench\.harness\.)(?:{'|'.join(lab)})\b")
    assert lab == ["lab", "formats"] and not [p for p in core if names.search(p.read_text(encoding="utf-8"))]
