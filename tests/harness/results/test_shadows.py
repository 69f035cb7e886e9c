"""True motions near runs: kept in a results folder, else published; read with suspicion."""

import pytest

from mbsbench.harness.base.files import FileError
from mbsbench.harness.results.shadows import (
    FILE,
    SYMPLECTIC,
    NearestMotion,
    choose_nearest,
    read_nearest,
    store_nearest,
)
from mbsbench.tests.factories import make_record

CHAIN = {"problem": "chain", "solver": "rattle", "status": "inaccurate"}


def test_a_run_has_its_own_else_that_of_its_published_settings(tmp_path) -> None:
    """By run_id and by case; other settings have none."""
    cases = {"a1": "mine", "b2": "chain rattle dt=0.001", "c3": "chain rattle"}
    own, like, other = (make_record(**CHAIN, run_id=run, case=case) for run, case in cases.items())
    store_nearest(tmp_path, make_record(**CHAIN, run_id="d4", case="another"), NearestMotion())
    store_nearest(tmp_path, own, NearestMotion(5.0, 5.77e-4, 1.65e-4, 1e-12))
    known = read_nearest(tmp_path)
    found, published = choose_nearest(own, known), choose_nearest(like, known)
    assert found is not None and published is not None and choose_nearest(other, known) is None
    assert found.words == "a true motion within 0.577 mm (rms 0.165 mm) over 5 s"
    assert published.until_s == 20.0 and published.words.endswith("over 20 s, as published")
    assert known["d4"].words == ""


def test_the_verdict_on_the_modified_energy() -> None:
    """None where it is not defined."""
    swings = (None, 0.5 * SYMPLECTIC, 2.0 * SYMPLECTIC)
    assert [NearestMotion(modified_energy=x).symplectic for x in swings] == ["", "yes", "not shown"]


@pytest.mark.parametrize("text", ["[]", '{"a": 1}', '{"a": {"until_s": "x"}}', "{"])
def test_a_file_of_another_kind_is_one_line(text: str, tmp_path) -> None:
    """As any file of a results folder."""
    (tmp_path / FILE).write_text(text)
    with pytest.raises(FileError, match=FILE):
        read_nearest(tmp_path)
