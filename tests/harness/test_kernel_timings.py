"""Timings are compared in units of a calibration kernel, so a slower machine is no regression."""

import json

import pytest

from harness.__main__ import main
from harness.kernels import TimingError, compared


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


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "not a file of"), ("[]", "not a file of"), ('{"benchmarks": 3}', "not a file of"),
     ('{"benchmarks": []}', "calibration"), ('{"benchmarks": [{"name": "x", "stats": {"min": 0}}]}', "> 0"),
     ('{"benchmarks": [{"name": "calibration", "stats": {"min": 1}}]}', "no kernel")],
)  # fmt: skip
def test_other_files_are_told(tmp_path, text, words):
    """One line."""
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(TimingError, match=words):
        compared(path, path)
