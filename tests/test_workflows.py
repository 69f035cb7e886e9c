"""The workflows of .github are valid YAML, and call what the Makefile and the repository have."""

import re
from pathlib import Path

import pytest

from mbsbench.harness.results.environment import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


@pytest.mark.parametrize("path", [*WORKFLOWS, ROOT / ".ci" / "run"], ids=lambda p: p.name)
def test_called_targets_are_in_the_makefile(path: Path):
    called = set(re.findall(r"(?<![\w-])make ([a-z][a-z-]*)", path.read_text(encoding="utf-8")))
    assert called
    assert called <= TARGETS


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_a_workflow_is_valid(path: Path):
    """Each job has a machine and steps; each step runs a command or uses an action of a stated version."""
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with `make docs`")
    plain = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert plain["name"] == path.stem
    assert plain[True] == ["push", "pull_request"]  # YAML 1.1 reads the key `on` as true
    for job in plain["jobs"].values():
        assert job["runs-on"] == "ubuntu-latest"
        for step in job["steps"]:
            assert ("run" in step) != ("uses" in step)
            assert re.fullmatch(r"[\w-]+/[\w-]+@v\d+", step.get("uses", "a/b@v1"))
