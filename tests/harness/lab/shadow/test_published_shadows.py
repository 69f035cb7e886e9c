"""The published table of the chain over 20 s: its page is made from its data, and its shadows are shadows."""

import importlib.util
import json

import pytest

from mbsbench.harness.judge.distance import GAP
from mbsbench.harness.results.environment import ROOT

pytestmark = pytest.mark.published
DATA = json.loads((ROOT / "results" / "published" / "chaos.json").read_text(encoding="utf-8"))


def load_script():
    """docs/list_shadows.py, which is in no package."""
    spec = importlib.util.spec_from_file_location("list_shadows", ROOT / "docs" / "list_shadows.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_made_from_the_data():
    """Table and paragraph; whoever changes either by hand, or the data alone, is told here."""
    script = load_script()
    (printed,) = script.TABLE.findall(script.PAGE.read_text(encoding="utf-8"))
    assert printed == script.format_page()


def test_gaps_are_closed_where_a_shadow_is_said_to_exist():
    """Over the time that the shadow is said to last."""
    found = [r["shadow"] for r in DATA["runs"].values() if r["shadow"].get("until_s")]
    assert len(found) >= 4
    assert all(
        s["gap_m"] < GAP and 0.0 <= s["start_m"] <= s["largest_m"] and s["rms_m"] < s["largest_m"] for s in found
    )


def test_published_data_are_json():
    """NaN is a word of Python's json alone; whatever else reads the file refuses the whole of it."""
    for file in sorted((ROOT / "results" / "published").rglob("*.json")):
        json.loads(file.read_text(encoding="utf-8"), parse_constant=lambda word, file=file: refuse(file, word))


def refuse(file, word):
    """A word that is none of JSON's."""
    raise AssertionError(f"{file}: {word} is no number of JSON")
