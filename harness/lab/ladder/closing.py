"""Draw the instances of a ladder after its entries are closed, from a value that nobody knew before.

Whoever may choose a seed draws until it suits; whoever may change a submission after the seed is known draws again. So
a ladder lists the digests that were entered, and only then is its value published.
"""

from dataclasses import dataclass
from pathlib import Path

from ...base.files import FileError, parse_toml, read_text

FILE = "ladder.toml"
TRIAL = "trial"  # the seed of a submission that is run without a value
KEYS = ("value", "entries")  # all keys of ``FILE``


@dataclass(frozen=True)
class LadderClosing:
    """The value of a ladder, published after entries were closed, and the digests that were entered before."""

    value: str
    entries: frozenset[str]

    def explain_rejection(self, digest: str, seed: str) -> str:
        """Return why the ladder does not admit a bundle; empty if it does.

        ``digest`` is that of its submission, ``seed`` what its instances were drawn with.
        """
        if seed == TRIAL:
            return "a trial: it was run without the value of this ladder"
        if seed != self.value:
            return f"a seed of its own choice: {seed!r}, not the value of this ladder"
        return "" if digest in self.entries else f"its digest {digest[:12]} was not entered before the value was known"


def read_closing(folder: Path) -> LadderClosing | None:
    """Read ``ladder.toml`` in a ladder's folder; return None if it is missing, as for a ladder of trials.

    Raise FileError if it is invalid.
    """
    path = folder / FILE
    if not path.exists():
        return None
    found = parse_toml(read_text(path, "the ladder"), FILE)
    value, entries = (found.get(key) for key in KEYS)
    if set(found) != set(KEYS) or not isinstance(value, str) or not value.strip() or value == TRIAL:
        raise FileError(f'{path}: value = "TEXT" and entries = [DIGESTS] were expected (got {", ".join(found)})')
    if not isinstance(entries, list) or not all(isinstance(e, str) and _is_digest(e) for e in entries):
        raise FileError(f"{path}: entries must be digests, 64 digits of 0-9a-f each (mbsbench submit FILE --digest)")
    return LadderClosing(value, frozenset(entries))


def _is_digest(text: str) -> bool:
    """Return whether a text is a sha256 in hexadecimal digits."""
    return len(text) == 64 and set(text) <= set("0123456789abcdef")
