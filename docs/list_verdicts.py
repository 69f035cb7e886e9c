"""Compare the verdict on each claim before and now, for the site; or write what was published before into its data.

    python docs/list_verdicts.py OLD.json      # git show COMMIT:results/published/claims.json

What was published before and why it changed is in ``docs/decisions/verdicts.toml``: ``before`` is written by this
command, ``reasons`` by hand.
"""

import argparse
import json
import tomllib
from pathlib import Path
from typing import Any

from mbsbench.harness.results.judgements.claims import ClaimFinding
from mbsbench.harness.results.judgements.files import CLAIMS, PUBLISHED, read_judgement
from mbsbench.reports.model.claim_words import describe_control, format_share, format_verdict

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "docs" / "decisions" / "verdicts.toml"


def cell(finding: ClaimFinding | None) -> str:
    """Format a verdict: ``reproduced if gain 0; for 39 of 76 tried``; a dash without one."""
    return "; ".join(filter(None, (format_verdict(finding), format_share(finding)))) if finding else "–"


def table() -> str:
    """Return the table of every claim before and now, with the reason of a change where one is recorded."""
    data = tomllib.loads(DATA.read_text(encoding="utf-8"))
    claims = {c.id: c for c in read_judgement(CLAIMS, PUBLISHED)}
    before, reasons = data.get("before", {}), data.get("reasons", {})
    heads = ("claim", "published before", "at the paper's settings", "beyond them", "control", "reason", "its runs")
    rows = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name in dict.fromkeys([*claims, *before]):
        c = claims.get(name)
        now = (cell(c.paper), cell(c.beyond), describe_control(c)) if c else ("dropped", "", "")
        again = f"`mbsbench claim {name} --run`" if c and c.map else ""
        rows.append(f"| {' | '.join((f'`{name}`', before.get(name, 'new'), *now, reasons.get(name, ''), again))} |")
    return "\n".join(rows) + "\n"


def read_earlier(plain: Any) -> dict[str, str]:
    """Return the verdict on each claim, by id, from the content of a ``claims.json`` of schema 1 or the present one."""
    if isinstance(plain, list):
        return {c["id"]: f"{c['verdict']} {c['because']['holds']} of {c['because']['settings']}" for c in plain}
    sides = (("", "paper"), ("beyond ", "beyond"))
    return {
        c["id"]: ", ".join(
            f"{words}{f['verdict']} {f['holds']} of {f['settings']}" for words, k in sides if (f := c[k])
        )
        for c in plain["claims"]
    }


def replace_before(text: str, before: dict[str, str]) -> str:
    """Return the text of the data with its last part, ``[before]``, replaced."""
    rows = "".join(f"{json.dumps(k)} = {json.dumps(v)}\n" for k, v in before.items())
    return text.partition("[before]\n")[0] + "[before]\n" + rows


def main() -> None:
    """Write the verdicts that were published before into ``verdicts.toml``."""
    parser = argparse.ArgumentParser(description="Write what was published before into verdicts.toml.")
    parser.add_argument("old", type=Path, metavar="OLD.json", help="claims.json published before")
    old = read_earlier(json.loads(parser.parse_args().old.read_text(encoding="utf-8")))
    DATA.write_text(replace_before(DATA.read_text(encoding="utf-8"), old), encoding="utf-8")


if __name__ == "__main__":
    main()
