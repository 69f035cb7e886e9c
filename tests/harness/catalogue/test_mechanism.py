"""A file of a mechanism is named as such, also in a copy of the package that cannot read it."""

import pytest

from mbsbench import make_problem
from mbsbench.harness.catalogue import mechanism


def test_a_copy_without_readers_says_so(monkeypatch):
    """A problem of a similar name, ``chain`` for ``chain.xml``, would be the wrong hint."""
    monkeypatch.setattr(mechanism, "load_readers", lambda: None)
    with pytest.raises(ValueError, match=r"^chain.xml: this copy of mbsbench has no readers of mechanisms' files"):
        make_problem("chain.xml")
    with pytest.raises(ValueError, match=r"unknown problem 'chain.txt' - did you mean 'chain'"):
        make_problem("chain.txt")


def test_the_files_that_are_named_are_those_that_readers_read():
    """An extension that no reader has would be refused by the whole package, too."""
    readers = mechanism.load_readers()
    assert readers is None or set(mechanism.UNREADABLE) == set(readers.SUFFIXES)
