"""The gate's verdict for machines and reviewers: JUnit XML for CI, Markdown for a merge request."""

import math
import re
from typing import Any
from xml.etree import ElementTree

from .judging import Finding, State, Verdict, has_moved

NOT_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")  # what XML 1.0 cannot hold


def junit(verdict: Verdict, suite: str) -> str:
    """One test case a finding; FAIL and XPASS are failures, XFAIL is skipped, a gate that judged nothing fails."""
    findings = verdict.findings or (Finding(State.FAIL, suite, "gate", math.nan, math.nan, "", "", "nothing judged"),)
    closed = sum(f.state in (State.FAIL, State.XPASS) for f in findings)
    skipped = sum(f.state is State.XFAIL for f in findings)
    counts = {"tests": str(len(findings)), "failures": str(closed), "errors": "0", "skipped": str(skipped)}
    root = ElementTree.Element("testsuites", counts)
    group = ElementTree.SubElement(root, "testsuite", {"name": _xml(f"gate {suite}"), **counts})
    for f in findings:
        case = ElementTree.SubElement(group, "testcase", {"classname": _xml(f.case), "name": _xml(f.what)})
        if f.state is State.XFAIL:
            ElementTree.SubElement(case, "skipped", {"message": _xml(f"expected to fail: {f.words}")})
        elif f.state is not State.PASS:
            kind = {"type": f.state.name, "message": _xml(said(f))}
            ElementTree.SubElement(case, "failure", kind).text = _xml(f.words)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def markdown(verdict: Verdict, suite: str) -> str:
    """A headline and a table of what did not pass or has moved."""
    counts = {s: sum(f.state is s for f in verdict.findings) for s in sorted(State, reverse=True)}
    words = ", ".join(f"{n} {s.name}" for s, n in counts.items() if n) or "nothing was judged"
    out = [f"## Gate `{suite}`: {'open' if verdict.is_open else 'CLOSED'}", "", f"{words}.", ""]
    shown = [f for f in verdict.findings if f.state is not State.PASS or has_moved(f)]
    if shown:
        out += ["| state | case | metric | measured | was | bound | unit | why |", "|---|---|---|---|---|---|---|---|"]
        for f in shown:
            numbers = [_number(f.measured), _number(f.value), f.bound]
            specs = [f.state.name, f.case, f.what, *numbers, f.unit, f.words if f.state is not State.PASS else "moved"]
            out.append("| " + " | ".join(map(_markdown, specs)) + " |")
        out.append("")
    return "\n".join(out)


def as_plain(verdict: Verdict, suite: str) -> dict[str, Any]:
    """The verdict as ``--json`` prints it."""
    findings = [
        {
            "state": f.state.name, "case": f.case, "metric": f.what, "measured": f.measured,
            "value": f.value, "bound": f.bound, "unit": f.unit, "why": f.words, "moved": has_moved(f),
        }
        for f in verdict.findings
    ]  # fmt: skip
    counts = {s.name: sum(f.state is s for f in verdict.findings) for s in sorted(State, reverse=True)}
    return {
        "suite": suite,
        "open": verdict.is_open,
        "state": verdict.state.name,
        "counts": counts,
        "findings": findings,
    }


def said(f: Finding) -> str:
    """A finding in a line."""
    if math.isnan(f.measured):
        return f"{f.state.name}: {f.words}"
    return f"{f.state.name}: {f.what} is {f.measured:.6g} {f.unit}, bound {f.bound}, was {f.value:.6g}"


def _number(x: float) -> str:
    return "" if math.isnan(x) else f"{x:.4g}"


def _markdown(text: str) -> str:
    flat = " ".join(text.split())
    return re.sub(r"([\\|<>`*_\[\]])", r"\\\1", flat)


def _xml(text: str) -> str:
    return NOT_XML.sub("?", text)
