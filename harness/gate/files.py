"""The result of the gate for machines and reviewers: JUnit XML for CI, Markdown for a merge request."""

import dataclasses
import math
import re
from typing import Any
from xml.etree import ElementTree

from .check import Finding, Judged, State

NOT_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")  # what XML 1.0 cannot hold


def junit(result: Judged, suite: str) -> str:
    """One test case a finding; FAIL and XPASS are failures, XFAIL is skipped, a gate that judged nothing fails."""
    findings = result.findings or (Finding(State.FAIL, suite, "gate", why="nothing judged"),)
    closed = sum(f.state in (State.FAIL, State.XPASS) for f in findings)
    skipped = sum(f.state is State.XFAIL for f in findings)
    counts = {"tests": str(len(findings)), "failures": str(closed), "errors": "0", "skipped": str(skipped)}
    root = ElementTree.Element("testsuites", counts)
    group = ElementTree.SubElement(root, "testsuite", {"name": _xml(f"gate {suite}"), **counts})
    for f in findings:
        case = ElementTree.SubElement(group, "testcase", {"classname": _xml(f.case), "name": _xml(f.metric)})
        if f.state is State.XFAIL:
            ElementTree.SubElement(case, "skipped", {"message": _xml(f"expected to fail: {f.why}")})
        elif f.state is not State.PASS:
            kind = {"type": f.state.name, "message": _xml(_said(f))}
            ElementTree.SubElement(case, "failure", kind).text = _xml(f.why)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def markdown(result: Judged, suite: str) -> str:
    """A headline and a table of what did not pass or has moved."""
    out = [f"## Gate `{suite}`: {'open' if result.is_open else 'CLOSED'}", "", f"{result.summary}.", ""]
    if result.notable:
        out += ["| state | case | metric | measured | was | bound | unit | why |", "|---|---|---|---|---|---|---|---|"]
        for f in result.notable:
            numbers = ["" if math.isnan(x) else f"{x:.4g}" for x in (f.measured, f.value)]
            why = f.why if f.state is not State.PASS else "moved"
            texts = (f.state.name, f.case, f.metric, *numbers, f.bound, f.unit, why)
            out.append("| " + " | ".join(map(_markdown, texts)) + " |")
        out.append("")
    return "\n".join(out)


def as_plain(result: Judged, suite: str) -> dict[str, Any]:
    """The result as ``--json`` prints it."""
    findings = [{**dataclasses.asdict(f), "state": f.state.name, "moved": f.moved} for f in result.findings]
    head = {"suite": suite, "open": result.is_open, "state": result.state.name}
    return {**head, "counts": result.counts, "findings": findings}


def _said(f: Finding) -> str:
    if math.isnan(f.measured):
        return f"{f.state.name}: {f.why}"
    return f"{f.state.name}: {f.metric} is {f.measured:.6g} {f.unit}, bound {f.bound}, was {f.value:.6g}"


def _markdown(text: str) -> str:
    return re.sub(r"([\\|<>`*_\[\]])", r"\\\1", " ".join(text.split()))


def _xml(text: str) -> str:
    return NOT_XML.sub("?", text)
