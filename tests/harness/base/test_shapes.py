"""A value that does not fit a shape is refused in one line with the place, the expected and the value."""

import json
import math
from enum import StrEnum
from typing import Annotated, Literal

import numpy as np
import pytest
from msgspec import Meta, field

from mbsbench.harness.base.files import FileError, parse_json, to_json, write_text
from mbsbench.harness.base.shapes import Finite, Positive, Shape, Text, convert_shape


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


class Part(Shape, frozen=True):
    name: Text
    size: Positive = 1.0
    place: Finite = 0.0
    count: Annotated[int, Meta(ge=1, le=9)] = 1
    colour: Colour = Colour.RED
    expect: Literal["pass", "fail"] | None = None
    sizes: dict[str, int] = field(default_factory=dict)
    names: str | tuple[str, ...] = ()


class Whole(Shape, frozen=True):
    parts: tuple[Part, ...] = ()
    maps: dict[str, Part] = field(default_factory=dict)


MISFITS = {
    '{"parts": [{"name": "a"}, {"nmae": "b"}]}': "f: parts 2: unknown key 'nmae' - did you mean 'name'?",
    '{"parts": [{"size": 2}]}': "f: parts 1: name is missing",
    '{"parts": [{"name": " "}]}': "f: parts 1: name must be text, not blank (got ' ')",
    '{"parts": [{"name": "a", "size": 0}]}': "f: parts 1: size must be a finite number > 0 (got 0)",
    '{"parts": [{"name": "a", "size": true}]}': "f: parts 1: size must be a finite number > 0 (got True)",
    '{"parts": [{"name": "a", "count": 10}]}': "f: parts 1: count must be a whole number <= 9 (got 10)",
    '{"parts": [{"name": "a", "count": 1.5}]}': "f: parts 1: count must be a whole number (got 1.5)",
    '{"parts": [{"name": "a", "colour": "bleu"}]}': "f: parts 1: unknown colour 'bleu' - did you mean 'blue'?",
    '{"parts": [{"name": "a", "expect": "x"}]}': "f: parts 1: unknown expect 'x' - known: pass, fail",
    '{"parts": [{"name": "a", "names": ["b", 3]}]}': "f: parts 1: names 2 must be text (got 3)",
    '{"parts": [{"name": "a", "names": 3}]}': "f: parts 1: names must be text or a list (got 3)",
    '{"parts": 3}': "f: parts must be a list (got 3)",
    "3": "f: must be a table (got 3)",
    '{"maps": {"x": {"name": "a"}, "y.z": {"name": 1}}}': "f: maps: y.z: name must be text, not blank (got 1)",
    '{"maps": {"x": {"name": "a", "sizes": {"]`": "c"}}}}': "f: maps: x: sizes: ]`: must be a whole number (got 'c')",
}


@pytest.mark.parametrize("text", MISFITS)
def test_a_misfit_is_one_line_with_its_place(text):
    """Lists count from 1, entries of tables go by their names."""
    with pytest.raises(FileError) as error:
        convert_shape(parse_json(text, "f"), Whole, "f")
    assert str(error.value) == MISFITS[text]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10**400, 10**5000], ids=range(5))
def test_numbers_that_are_none_are_refused(value):
    """NaN fits no bound, and no float holds ten to the 400."""
    for key in ("size", "place", "count"):
        with pytest.raises(FileError, match=f"f: {key} ") as error:
            convert_shape({"name": "a", key: value}, Part, "f")
        assert len(str(error.value)) < 120


@pytest.mark.parametrize("text", ["", "{", "[NaN]", "[" * 100_000, "1" * 5000, '"\ud800"', '{"a": 1e999}'])
def test_what_is_no_json_is_refused_in_a_line(text):
    """Nor does depth end the process."""
    with pytest.raises(FileError) as error:
        parse_json(text.encode("utf-8", "surrogatepass"), "f")
    assert str(error.value).startswith("f: ") and "\n" not in str(error.value)


def test_json_has_null_for_a_number_that_does_not_exist():
    value = {"a": math.nan, "b": np.float64(math.inf), "c": np.array([1.0, math.nan]), "d": np.int64(3), "e": (1, "é")}
    for indent in (0, 1):
        assert json.loads(to_json(value, indent=indent), parse_constant=pytest.fail) == {
            "a": None,
            "b": None,
            "c": [1.0, None],
            "d": 3,
            "e": [1, "é"],
        }


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    """A write that fails half-way leaves the old file, and nothing beside it."""
    path = tmp_path / "x.txt"
    write_text(path, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(path, "new \ud800")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
