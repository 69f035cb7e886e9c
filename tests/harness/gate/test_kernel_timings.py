"""Timings are compared in units of a calibration kernel, so a slower machine is no regression."""

import json
import re

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.gate.kernels import TimingError, compared


def timings(path, **least):
    path.write_text(json.dumps({"benchmarks": [{"name": k, "stats": {"min": v}} for k, v in least.items()]}))
    return path


def test_a_slower_machine_is_no_regression_but_a_slower_kernel_is(tmp_path, capsys):
    """All three times longer: ratios stay. One kernel alone twice as long, or gone: exit code 1."""
    a = timings(tmp_path / "a.json", test_calibration=1e-3, step=2e-3, residual=1e-4)
    same = timings(tmp_path / "same.json", test_calibration=3e-3, step=6e-3, residual=3e-4)
    worse = timings(tmp_path / "worse.json", test_calibration=3e-3, step=12e-3, residual=3e-4)
    gone = timings(tmp_path / "gone.json", test_calibration=1e-3, step=2e-3)
    assert main(["kernels", "compare", str(a), str(same)]) == 0
    assert main(["kernels", "compare", str(a), str(worse)]) == 1
    assert main(["kernels", "compare", str(a), str(gone)]) == 1
    assert main(["kernels", "compare", str(gone), str(a)]) == 0  # a new kernel is none
    assert main(["kernels", "compare", str(a), str(worse), "--limit", "3"]) == 0
    assert compared(a, worse)[0].kernel == "step" and compared(a, worse)[0].factor == pytest.approx(2.0)
    capsys.readouterr()
    assert main(["kernels", "compare", str(a), str(gone), "--json"]) == 1
    assert {json.loads(x)["kernel"] for x in capsys.readouterr().out.splitlines()} == {"step", "residual"}


def test_a_file_is_kept_trimmed_and_is_then_what_newer_ones_are_compared_with(tmp_path, capsys, monkeypatch):
    """Times and where they come from, nothing else; the newest of the folder is the other side."""
    from mbsbench.cli import kernels as command
    from mbsbench.harness.gate import kernels

    long = {"min": 1e-3, "rounds": 5, "data": [1.0] * 1000}
    plain = {
        "benchmarks": [{"name": n, "stats": long, "params": 1} for n in ("test_calibration", "step")],
        "machine_info": {"cpu": {"brand_raw": "a processor"}, "node": "name of a machine"},
        "commit_info": {"id": "abc"}, "datetime": "2026",
    }  # fmt: skip
    local, baseline = tmp_path / "local", tmp_path / "kernels.json"
    local.mkdir()
    (local / "20260101-000000.json").write_text("{")
    (local / "20260102-000000.json").write_text(json.dumps(plain))
    monkeypatch.setattr(command, "newest", lambda: kernels.newest(local))
    monkeypatch.setattr(command, "BASELINE", baseline)
    assert main(["kernels", "keep", "--out", str(baseline)]) == 0
    text = baseline.read_text()
    assert len(text) < 500 and "a processor" in text and "abc" in text and "name of a machine" not in text
    assert main(["kernels", "compare"]) == 0
    timings(local / "20260103-000000.json", test_calibration=1e-3, step=2e-3)
    assert main(["kernels", "compare"]) == 1
    assert "step" in capsys.readouterr().out
    assert main(["kernels", "keep", str(local / "20260101-000000.json"), "--out", str(baseline)]) == 2
    assert baseline.read_text() == text


def test_without_timings_the_command_says_how_to_take_some(tmp_path, capsys, monkeypatch):
    """Exit code 2, one line."""
    monkeypatch.chdir(tmp_path)
    assert main(["kernels", "compare"]) == 2
    assert "make bench-kernels" in capsys.readouterr().err


def test_the_committed_baseline_has_every_kernel():
    """One that is timed and not in it would never be compared."""
    from mbsbench.harness.gate.kernels import BASELINE, ratios
    from mbsbench.harness.results.environment import ROOT

    held = {name.split("::")[1].split("[")[0] for name in ratios(BASELINE)}
    files = [p.read_text() for p in (ROOT / "tests" / "benchmarks").glob("test_*.py")]
    written = {w for text in files for w in re.findall(r"^def (test_\w+)\(benchmark", text, flags=re.M)}
    assert held == written - {"test_calibration"}


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "not a file of"), ("[]", "not a file of"), ('{"benchmarks": 3}', "not a file of"),
     ('{"benchmarks": []}', "calibration"), ('{"benchmarks": [{"name": "x", "stats": {"min": 0}}]}', "> 0"),
     ('{"benchmarks": [{"name": "calibration", "stats": {"min": 1}}]}', "no kernel")],
)  # fmt: skip
def test_other_files_are_reported(tmp_path, text, words):
    """One line."""
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(TimingError, match=words):
        compared(path, path)
