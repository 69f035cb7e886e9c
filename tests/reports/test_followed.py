"""How long motions are followed: bars of the simulated time, and what is not known beyond the reference."""

from mbsbench.reports.model.followed import followed
from mbsbench.reports.model.results import Run, Variant

from .conftest import record


def test_bars_end_where_the_error_passes_or_the_reference_ends():
    """Of 4 s, compared to 3 s: left at 2 s, followed to the end of the reference, never compared, stopped at 1 s."""
    asked = {"t_end_s": 4.0, "t_reached_s": 4.0, "compared_to_s": 3.0}

    def until(*times: float) -> dict[str, float]:
        return dict(zip(("accurate_until_s", "accurate_until_1pct_s", "accurate_until_0p1pct_s"), times, strict=True))

    stopped = {**asked, "t_reached_s": 1.0, "compared_to_s": 1.0, **until(1.0, 1.0, 0.5)}
    runs = [
        Run(record("a1", "alpha", **asked, **until(2.0, 1.0, 0.5))),
        Run(record("a2", "alpha", dt_s=0.1, **asked, **until(0.5, 0.2, 0.1))),  # coarser
        Run(record("b1", "beta", **asked, **until(3.0, 3.0, 2.0))),
        Run(record("c1", "gamma")), Run(record("d1", "delta", "diverged", **stopped)),
    ]  # fmt: skip
    beta, alpha, delta = followed(Variant("p", "p", tuple(runs)))
    assert [f.run.record.run_id for f in (beta, alpha, delta)] == ["b1", "a1", "d1"]
    assert alpha.known == 4.0 and alpha.shades == (("tenth", 12.5), ("one", 12.5), ("ten", 25.0)) and not alpha.open
    assert beta.shades == (("tenth", 50.0), ("one", 25.0), ("ten", 0.0)) and beta.open and not delta.open
    assert beta.words == "at least 3 s (10 %), at least 3 s (1 %), 2 s (0.1 %)"
    assert delta.words == "1 s (10 %), 1 s (1 %), 0.5 s (0.1 %)"
