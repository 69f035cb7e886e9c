"""What to do where a test finds published results that other code than this has computed."""

REMEDY = (
    "published results are of other code than this. If no bit moved: python docs/carry_over.py PARENT; if a law alone "
    "changed: mbsbench remeasure RESULTS, then mbsbench judge RESULTS --publish; if motions did: mbsbench run referee "
    "--resume, mbsbench judge --publish, make engines bench pictures. PARENT, RESULTS and why: CONTRIBUTING.md, "
    "'When published results are stale'"
)
