"""Format the result of the gate: JUnit XML and annotations for CI, Markdown for a merge request."""

import math
import re
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from ...results.findings import Finding, Verdict
from .check import (
    STATES,
    count_cases,
    count_states,
    describe_counts,
    describe_gate,
    find_worst_verdict,
    has_moved,
    is_open,
    list_missing_packages,
    select_notable,
)

LEFT_OUT = {Verdict.XFAIL: "expected to fail: ", Verdict.OPEN: ""}  # verdicts that JUnit calls skipped, with a prefix
NOT_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")  # characters that XML 1.0 cannot hold


JUNIT_BEGUN = (  # written for a gate that has no verdict yet
    '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites tests="1" failures="1" errors="0" skipped="0">'
    '<testsuite name="gate" tests="1" failures="1" errors="0" skipped="0"><testcase classname="gate" name="verdict">'
    '<failure type="FAIL" message="not finished">the gate was ended before its verdict</failure></testcase>'
    "</testsuite></testsuites>\n"
)
MARKDOWN_BEGUN = "## Gate: not finished\n\nIt was ended before its verdict, or is still at work.\n"


def format_junit(findings: Sequence[Finding], suite: str) -> str:
    """Return the gate's findings as JUnit XML with a test case for each finding.

    FAIL and XPASS become failures, XFAIL and SKIP are skipped; a gate that judged nothing has one failure.
    """
    nothing = Finding("gate", verdict=Verdict.FAILED, subject=suite, why="nothing judged")
    findings = findings if any(f.is_tested for f in findings) else (*findings, nothing)
    closed, skipped = sum(not f.holds for f in findings), sum(f.verdict in LEFT_OUT for f in findings)
    counts = {"tests": str(len(findings)), "failures": str(closed), "errors": "0", "skipped": str(skipped)}
    root = ElementTree.Element("testsuites", counts)
    group = ElementTree.SubElement(root, "testsuite", {"name": _escape_xml(f"gate {suite}"), **counts})
    for f in findings:
        named = {"classname": _escape_xml(f.subject), "name": _escape_xml(f.quantity)}
        case = ElementTree.SubElement(group, "testcase", named)
        if f.verdict in LEFT_OUT:
            ElementTree.SubElement(case, "skipped", {"message": _escape_xml(f"{LEFT_OUT[f.verdict]}{f.why}")})
        elif not f.holds:
            kind = {"type": STATES[f.verdict], "message": _escape_xml(_describe_finding(f))}
            ElementTree.SubElement(case, "failure", kind).text = _escape_xml(f.why)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def format_markdown(findings: Sequence[Finding], suite: str) -> str:
    """Return Markdown for a merge request: a headline, and a table of findings that did not pass or have moved."""
    out = [f"## Gate `{suite}`: {describe_gate(findings)}", "", f"{describe_counts(findings)}.", ""]
    if notable := select_notable(findings):
        out += ["| state | case | metric | measured | was | bound | unit | why |", "|---|---|---|---|---|---|---|---|"]
        for row in map(_flatten_finding, notable):
            numbers = {k: "" if math.isnan(row[k]) else f"{row[k]:.4g}" for k in ("measured", "value")}
            texts = {**row, **numbers, "why": "moved" if row["state"] == "PASS" else row["why"]}
            shown = ("state", "case", "metric", "measured", "value", "bound", "unit", "why")
            out.append("| " + " | ".join(_escape_markdown(texts[k]) for k in shown) + " |")
        out.append("")
    return "\n".join(out)


def format_annotations(findings: Sequence[Finding], suite: str) -> list[str]:
    """Return an error command of GitHub Actions for each case that closes the gate, with its first cause."""
    closing: dict[str, list[Finding]] = {}
    for f in findings:
        if not f.holds:
            closing.setdefault(f.subject, []).append(f)
    out = []
    for case, (first, *more) in closing.items():
        words = _describe_finding(first) + (f" (and {len(more)} more of this run)" if more else "")
        out.append(f"::error title={_escape_command(f'gate {suite}: {case}', ':,')}::{_escape_command(words)}")
    return out


def _escape_command(text: str, more: str = "") -> str:
    """Escape the characters that end a workflow command, and the characters ``more`` that end one of its properties."""
    return re.sub(f"[%\r\n{more}]", lambda found: f"%{ord(found[0]):02X}", text)


def make_json_object(findings: Sequence[Finding], suite: str) -> dict[str, Any]:
    """Return the gate's findings as a dict for ``--json``."""
    head = {
        "suite": suite,
        "open": is_open(findings),
        "state": STATES[find_worst_verdict(findings)],
        "counts": count_states(findings),
        "cases": count_cases(findings),
        "not_measured": list_missing_packages(findings),
    }
    return {**head, "findings": [_flatten_finding(f) for f in findings]}


def _flatten_finding(f: Finding) -> dict[str, Any]:
    """Return a finding as plain values by name, for ``--json`` and the table of Markdown."""
    return {
        "state": STATES[f.verdict],
        "case": f.subject,
        "metric": f.quantity,
        "measured": f.value,
        "value": f.before,
        "bound": f.required,
        "unit": f.unit,
        "why": f.why,
        "moved": has_moved(f),
    }


def _describe_finding(f: Finding) -> str:
    """Return state, metric, value, bound and earlier value of a finding; without a value, the reason."""
    if math.isnan(f.value):
        return f"{STATES[f.verdict]}: {f.why}"
    number = f"{f.value:.6g} {f.unit}, bound {f.required}, was {f.before:.6g}"
    return f"{STATES[f.verdict]}: {f.quantity} is {number}"


def _escape_markdown(text: str) -> str:
    """Return a text on one line, with the characters escaped that have a meaning in Markdown."""
    return re.sub(r"([\\|<>`*_\[\]])", r"\\\1", " ".join(text.split()))


def _escape_xml(text: str) -> str:
    """Return a text with ``?`` in place of characters that XML cannot hold."""
    return NOT_XML.sub("?", text)
