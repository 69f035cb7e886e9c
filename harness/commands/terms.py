"""What the subcommands share: words for wrong calls, ``key=value`` arguments, plugins."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from ..cache import ROOT, is_checkout
from ..catalogue import plugins, registry
from ..sandbox.trial import tried


class UsageError(ValueError):
    """A wrong call: one line, exit code 2."""


class Parser(argparse.ArgumentParser):
    """argparse with its complaint in one line."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


def assignments(given: Sequence[str], what: str) -> dict[str, str]:
    """``["k=v", ...]`` as a dict; each key once."""
    out: dict[str, str] = {}
    for text in given:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key or not value.strip():
            raise UsageError(f"{what} takes key=value (got {text!r})")
        if key in out:
            raise UsageError(f"{what} {key} is given twice")
        out[key] = value.strip()
    return out


def load_plugins(paths: Sequence[str]) -> tuple[str, ...]:
    """Load the named plugins, each tried in a process of its own first; their full names."""
    for path in paths:
        tried(f"plugin {path}", lambda path=path: registry.load_plugin(path))  # type: ignore[misc]
    return tuple(plugins.resolved(p) for p in paths)


def check_ours(path: Path, option: str) -> None:
    """Committed files are changed in a checkout; those of an installed package stay as they are."""
    if path.resolve().is_relative_to(ROOT) and not is_checkout():
        raise UsageError(f"{path.name} is part of the installed package; give another place with {option}")


def check_writable(out: Path) -> None:
    """Before the run: nobody wants to learn after an hour that the folder is not there."""
    probe = out.parent / f".{out.name}.{os.getpid()}.probe"
    try:
        if out.is_dir():
            raise UsageError(f"cannot write {out}: it is a folder")
        with probe.open("xb"):
            pass
        probe.unlink()
    except OSError as error:
        raise UsageError(f"cannot write {out}: {error.strerror or error}") from None
