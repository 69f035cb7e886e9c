"""Name the state of the code that measures by digests, one for each column, and find the columns that changed since."""

import hashlib

from ..base.shapes import Shape


class ColumnDigests(Shape, frozen=True):
    """The digests of one state of the code that measures (``harness.catalogue.codes``)."""

    measuring: str  # of what measures series and judges them: laws, scales, reference, status
    columns: dict[str, str]  # of the own function of each measured column, by its name

    @property
    def digest(self) -> str:
        """The digest of all of them, as the column ``measured_by`` has it."""
        text = "\0".join([self.measuring, *(f"{k}\0{v}" for k, v in sorted(self.columns.items()))])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def list_stale(self, now: "ColumnDigests") -> tuple[str, ...]:
        """Return the names of the columns whose function is another one in ``now``.

        Columns that only one of the two has are left out. If the code that measures the series has changed, return all
        columns.
        """
        if self.measuring != now.measuring:
            return tuple(self.columns)
        return tuple(k for k, v in self.columns.items() if now.columns.get(k, v) != v)
