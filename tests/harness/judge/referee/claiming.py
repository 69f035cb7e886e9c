"""One claim, its map and its runs, made up: what verdicts are tested on."""

from mbsbench.harness.judge.referee.claims.judging import judge_claims
from mbsbench.harness.judge.referee.claims.register import parse_register
from mbsbench.harness.results.judgements.claims import ClaimFinding, ClaimVerdict, JudgedClaim, VerdictEvidence
from mbsbench.tests.factories import make_record, parse_specs

HEAD = 'id = "c"\nsection = "5.2"\nfigure = [5]\nquote = "words"\nclaim = "ours"\n'
SUITE = """
[[runs]]
problem = "spherical_pendulum"
solver = "ida_index1"
options = { coordinates = ["euler313", "quaternion"], lambda_in_error_test = [true, false] }
rtol = [1e-3, 1e-4, 1e-6]
max_step = 0.01

[[runs]]
problem = "spherical_pendulum"
solver = "gc_weak_form"
dt = 0.01
"""
MAP = """
[solvers]
ida_index1 = "IDA was run, which is not ode15i"

[maps.m]
over = [{ problem = "spherical_pendulum", solver = "ida_index1", max_step = 0.01, tolerance = "any", chart = "any", lambda_in_error_test = "any" }]
dimensions = { tolerance = 3, chart = 2, lambda_in_error_test = 2 }

[maps.p]
over = [{ map = "m" }]
printed = { chart = "euler313", tolerance = 1e-3 }

[maps.gc]
over = [{ problem = "spherical_pendulum", solver = "gc_weak_form", step = 0.01, tolerance = "any" }]

[[claims]]
"""  # noqa: E501
TEST = 'map = "m"\ntests = [{ metric = "column", name = "phi_max", at_most = 1.0, unit = "m" }]\n'
RUNS = parse_specs(SUITE)


def judged(name, verdict, kind="result"):
    """A claim with its verdict beyond the paper's settings, judged from nothing."""
    found = ClaimFinding(ClaimVerdict(verdict))
    return JudgedClaim(
        name, kind, "5.1", (1,), "words", name, None, found, (), (), VerdictEvidence(), (), (), {}, (), (), {}, ()
    )


def options(spec):
    return {"chart": spec.options.get("coordinates", "quaternion"), "lam": spec.options.get("lambda_in_error_test")}


def claim(text=TEST, records=None, of=lambda r: None, specs=RUNS):
    """The verdict on one claim; by default every run has |phi| = 0.5 m."""
    found = [make_record(c, phi_max=0.5) for c in specs] if records is None else records
    return judge_claims(parse_register(MAP + HEAD + text), specs, found, of)[0]
