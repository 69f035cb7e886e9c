"""Name the registers of claims: the paper's, and that of the field's textbooks and manuals.

Both are TOML files that the same functions read and judge (``claims``). They differ in the runs that their claims are
tried on, and in the file of their verdicts.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from ...results.judgements.claims import JudgedClaim
from ...results.judgements.files import CLAIMS, FIELD_CLAIMS, File
from .claims.register import REGISTER, Register, read_register


@dataclass(frozen=True)
class RegisterPlace:
    """A register of claims: its file, the runs that its claims are tried on, and the file of their verdicts."""

    name: Literal["paper", "field"]  # as in ``JudgedClaim.register``
    whose: str  # in sentences
    path: Path
    suites: tuple[str, ...]  # claims are tried on the runs of these
    whole: str  # the suite that has every run of its claims
    file: File[tuple[JudgedClaim, ...]]
    only: str = ""  # the id of the one claim that is read; empty for all

    def read(self) -> Register:
        """Read the register, with all its claims or with one."""
        register = read_register(self.path)
        own = tuple(c for c in register.claims if self.only in ("", c.id))
        return replace(register, claims=own)


PAPER = RegisterPlace(
    "paper",
    "of the paper",
    REGISTER,
    ("paper", "claims", "readings", "controls", "work"),  # all are in ``referee``
    "referee",
    CLAIMS,
)
FIELD = RegisterPlace(
    "field",
    "of textbooks and manuals",
    REGISTER.with_name("field.toml"),
    ("bench", "field"),  # what `make bench` runs, and the few runs that it lacks
    "field",
    FIELD_CLAIMS,
)
PLACES = (PAPER, FIELD)
