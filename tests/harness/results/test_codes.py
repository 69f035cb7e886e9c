"""The extent of a digest, by law: words and layout never, an operator in every module whose numbers pass through it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mbsbench
from mbsbench.harness.base.cache import write_sealed_file
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.codes import ARRANGES, MEASURING, RUNNING, WORDS, Sources, is_inside
from mbsbench.harness.judge.metrics.summary import DECLARED
from mbsbench.harness.results.environment import ROOT

COMPILED = ("solvers/formulations/compiled/evaluation.py",)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Where parsed modules are kept: a test parses those it edits."""
    return tmp_path_factory.mktemp("kept") / "parsed.json"


@pytest.fixture(scope="module")
def whole(kept):
    return Sources(ROOT, kept)


@pytest.fixture
def edited(tmp_path, kept):
    """The digests after an edit of a file of a copy: ``edited(place, before, after)``."""

    def make(place, *pair):
        root = tmp_path / "copy"
        if not root.exists():
            for name in ("cli", "harness", "problems", "solvers"):
                shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__", "*.nb*"))
            shutil.copytree(ROOT / "locks", root / "locks")
        text = (ROOT / place).read_text(encoding="utf-8")
        if len(pair) == 2:
            assert pair[0] in text, (place, pair[0])
            text = text.replace(*pair, 1)
        else:
            text = pair[0](text)
        (root / place).write_text(text, encoding="utf-8")
        return Sources(root, kept)

    return make


def changed(before, after):
    """The names whose digest is another."""
    return {k for k in before if before[k] != after[k]}


def operator(text):
    """The first plus between two words that is code becomes a minus."""
    lines = text.splitlines(keepends=True)
    start = next(k for k, line in enumerate(lines) if line.startswith(("def ", "@")))
    k = next(k for k in range(start, len(lines)) if re.search(r"^ {4}[^\"#]*= [^\"#]*\w \+ \w", lines[k]))
    return "".join([*lines[:k], re.sub(r"(\w) \+ (\w)", r"\1 - \2", lines[k], count=1), *lines[k + 1 :]])


def reworded(text):
    """With a comment, another docstring and more empty lines."""
    return "# words\n" + text.replace('"""', '"""Other words. ', 1).replace("\n\n\n", "\n\n\n\n")


def test_every_entry_of_the_catalogue_has_a_digest(whole):
    ours = [n for n, e in registry.solvers().items() if e.make.__module__.startswith("mbsbench.")]
    unlike = set(whole.solvers) ^ set(ours)
    assert not unlike, f"in the catalogue a solver is a class marked @solver(NAME), see docs/adding.md: {unlike}"
    assert len(set(whole.solvers.values())) == len(ours)
    assert set(whole.problems) == {n for n in registry.problems() if registry.is_own_problem(n)}


def test_entries_of_the_catalogue_import_modules():
    """Names of ``mbsbench`` itself are loaded when they are used, so that no digest would follow them."""
    entries = [p for folder in ("problems", "solvers") for p in (ROOT / folder).rglob("*.py")]
    public = re.compile(r"^\s*from (?:mbsbench|\.+) import (?:\(\s*)?(\w+)", re.MULTILINE)
    used = {(p.name, name) for p in entries for name in public.findall(p.read_text(encoding="utf-8"))}
    assert not {one for one in used if one[1] in mbsbench.__all__}, "import from ..harness or ..solvers: docs/adding.md"


def test_comments_docstrings_and_layout_change_nothing(whole, edited):
    """Of a solver, of a kernel and of what measures, all three at once."""
    for place in ("solvers/rattle.py", COMPILED[0], "harness/judge/metrics/measure.py"):
        after = edited(place, reworded)
    assert not changed(whole.solvers, after.solvers) and not changed(whole.problems, after.problems)
    assert after.measuring == whole.measuring and after.running == whole.running


def test_another_shape_in_an_annotation_changes_nothing(whole, edited):
    after = edited("harness/judge/metrics/passes.py", 'Float[np.ndarray, "nt nb"]', 'Float[np.ndarray, "nt nb 3"]')
    assert after.measuring == whole.measuring


def test_an_edit_of_one_solver_asks_for_it_alone(whole, edited):
    after = edited("solvers/rattle.py", "rate=self.rate", "rate=2.0 * self.rate")
    assert changed(whole.solvers, after.solvers) == {"rattle"}
    assert not changed(whole.problems, after.problems) and after.measuring == whole.measuring
    assert after.digest_run_code("chain", "rattle") != whole.digest_run_code("chain", "rattle")
    assert after.digest_run_code("chain", "gc_weak_form") == whole.digest_run_code("chain", "gc_weak_form")


def test_an_edit_of_the_kernel_asks_for_all_solvers_that_march_on_it(whole, edited):
    """Not the ones on casadi's graphs."""
    found = changed(whole.solvers, edited(COMPILED[0], operator).solvers)
    assert found >= {"rattle", "rkmk_dop853", "lie_variational", "energy_momentum"}
    assert not found & {"ida_index1", "ida_index3", "ndf_index1", "rk45_strong_form"}


def test_an_edit_of_a_declared_joint_asks_for_every_problem(whole, edited):
    """Kinds of joints are found by listing their folder, not by an import."""
    after = edited("harness/mechanics/joints/kinds/distance.py", "d @ d - p.length", "d @ d + p.length")
    assert changed(whole.problems, after.problems) == set(whole.problems)


def test_an_edit_of_a_problem_or_of_measuring_asks_for_theirs(whole, edited):
    after = edited("problems/exact/lagrange_top.py", operator)
    assert not changed(whole.solvers, after.solvers)
    asked = changed(whole.problems, after.problems)
    assert "heavy_top" in asked and "chain" not in asked
    after = edited("harness/judge/metrics/scales.py", operator)
    assert after.measuring != whole.measuring and not changed(whole.solvers, after.solvers)


@pytest.mark.parametrize("place", ["metrics/measure", "metrics/scales", "law", "distance", "metrics/peaks"])
def test_an_edit_of_what_measures_leaves_every_motion(whole, edited, place):
    """Motions and costs stay; what is measured of them is out of date, all columns of it."""
    after = edited(f"harness/judge/{place}.py", lambda text: text + "\nADDED = 1\n")
    assert (after.solvers, after.problems, after.running) == (whole.solvers, whole.problems, whole.running)
    assert after.digest_run_code("heavy_top", "rattle") == whole.digest_run_code("heavy_top", "rattle")
    assert whole.columns.list_stale(after.columns) == tuple(whole.columns.columns)


ADDED = """
    energy_span_J: float = column(
        "span of the energy error",
        of=lambda run: float(np.ptp(run.series.energy_error)),
        head="Span",
        unit="J",
    )
"""
BEFORE = "    energy_allowed_J: float = column("


def test_a_column_that_is_added_makes_nothing_stale(whole, edited):
    """Neither motions, nor what is measured of them, nor any other column, those in the same file least of all."""
    text = "import numpy as np\n\nfrom ...mechanics.types import ALLOWED"
    after = edited(
        "harness/columns/declared/energy.py",
        lambda t: t.replace("from ...mechanics.types import ALLOWED", text).replace(BEFORE, f"{ADDED}{BEFORE}"),
    )
    assert (after.solvers, after.problems, after.running) == (whole.solvers, whole.problems, whole.running)
    assert after.measuring == whole.measuring
    assert after.columns.columns.keys() - whole.columns.columns.keys() == {"energy_span_J"}
    assert whole.columns.list_stale(after.columns) == ()
    assert after.columns.list_stale(whole.columns) == ()
    assert after.columns.digest != whole.columns.digest


@pytest.mark.parametrize(
    ("place", "before", "after", "stale"),
    [
        ("declared/energy.py", "run.series.energy_error[-1]", "run.series.energy_error[0]", {"energy_drift_end_J"}),
        ("declared/energy.py", "QUARTER = 0.25", "QUARTER = 0.2", {"first", "last"}),
        ("declared/errors.py", "run.take_judged(name)", "run.take_compared(name)", {"judged"}),
        ("declared/constraints.py", "run.series.phi_norm,", "2 * run.series.phi_norm,", {"phi_max"}),
        ("declared/way_back.py", "None if back is None", "None if back is not None", {"return_error"}),
        ("numbers.py", "w * (t - t0) * (a - a0)", "w * (t + t0) * (a - a0)", None),
        ("identity.py", "GOLDEN % 1.0", "GOLDEN % 2.0", {"problem_fingerprint"}),
    ],
)  # fmt: skip
def test_another_function_of_a_column_asks_for_that_column_alone(whole, edited, place, before, after, stale):
    """Wherever it stands: in its declaration, or in what that calls; ``numbers`` is used by what measures, too."""
    other = edited(f"harness/columns/{place}", before, after)
    assert other.running == whole.running
    found = whole.columns.list_stale(other.columns)
    if stale is None:
        assert found == tuple(whole.columns.columns)
        return
    assert other.measuring == whole.measuring and found
    assert all(any(word in name for word in stale) for name in found)
    assert all(any(word in name for name in found) for word in stale)


def test_words_and_places_of_a_column_are_none_of_its_number(whole, edited):
    """Meaning, head, unit, order, table, limit: no number passes through them."""
    for place, pair in (
        ("energy", ('"energy error at the last step, with its sign"', '"other words"')),
        ("energy", ("order=60", "order=65")),
        ("constraints", ("limit=lambda r: r.phi_limit_m", "limit=lambda r: 2.0 * r.phi_limit_m")),
        ("work", ('tables=("problem",)', "tables=()")),
    ):
        after = edited(f"harness/columns/declared/{place}.py", *pair)
    after = edited("harness/columns/declaring.py", lambda text: text + "\nADDED = 1\n")
    assert after.columns == whole.columns


def test_every_measured_column_has_a_digest_and_no_other(whole):
    """By the declarations as they are loaded, so that none is overlooked in the text."""
    measured = {name for name, d in DECLARED.items() if d.of is not None or d.along is not None}
    assert whole.columns.columns.keys() == measured and len(measured) > 60


@pytest.mark.parametrize(
    ("place", "before", "after"),
    [
        ("harness/run/contract.py", "max(times)", "0.5 * max(times)"),
        ("harness/base/clock.py", "used.ru_utime + used.ru_stime", "used.ru_utime"),
        ("harness/base/forked_process.py", "usage.ru_utime + usage.ru_stime", "usage.ru_utime"),
        ("harness/base/isolation.py", "set_subreaper(own)", "set_subreaper(parent)"),
    ],
)
def test_another_count_of_cpu_time_is_another_measurement(whole, edited, place, before, after):
    """Costs are published, too: those counted in another way are out of date, with their runs."""
    other = edited(place, before, after)
    assert other.running != whole.running
    assert other.digest_run_code("chain", "rattle") != whole.digest_run_code("chain", "rattle")


def test_what_only_arranges_asks_for_nothing(whole, edited):
    """How records are stored, processes are run and commands are worded."""
    for place in ("harness/results/store.py", "harness/run/pool.py", "cli/judge.py"):
        after = edited(place, lambda text: text + "\nADDED = 1\n")
    assert (after.solvers, after.problems, after.measuring) == (whole.solvers, whole.problems, whole.measuring)
    assert (after.running, after.columns) == (whole.running, whole.columns)


def test_the_digest_covers_all_that_a_run_runs(whole):
    """A module that a worker loads and the digest leaves out could change numbers unseen; these only arrange."""
    code = "import sys, mbsbench.harness.run.supervisor as s; s.load_readers(); print(*[m.__file__ for n, m in sys.modules.items() if n.startswith('mbsbench.')])"  # noqa: E501
    done = subprocess.run((sys.executable, "-c", code), cwd=ROOT, capture_output=True, text=True, check=True)
    files = [Path(f).resolve().relative_to(ROOT).as_posix() for f in done.stdout.split()]
    loaded = {f for f in files if not f.endswith("__init__.py")}
    covered = whole.list_imported(*RUNNING, *MEASURING)[0].keys()
    by_column = "harness/columns/declared"  # each column has its own digest
    left_out = {p for p in loaded - covered if not is_inside(p, (*ARRANGES, WORDS, by_column))}
    assert left_out == {
        *(f"harness/run/{name}.py" for name in ("protocol", "supervisor", "warmup")),
        *(f for f in loaded if f.startswith("harness/formats/mechanisms/")),  # files of others
        "harness/mechanics/types/presentations.py",  # names of options
        "harness/base/line_process.py",  # carries lines between processes
    }


def test_another_version_of_a_package_asks_for_those_that_use_it(whole, edited):
    after = edited("locks/requirements.lock", lambda text: text.replace("scipy-dae==", "scipy-dae==9"))
    found = changed(whole.solvers, after.solvers)
    assert "ndf_index1" in found and not found & {"rattle", "gc_weak_form"}


def test_what_was_parsed_is_kept_and_a_damaged_file_costs_only_time(tmp_path, whole):
    keep = tmp_path / "parsed.json"
    for text in ("{", '{"1 a": [1]}', "[]"):
        write_sealed_file(keep, text.encode())
        assert Sources(ROOT, keep).digest_modules("solvers/rattle") == whole.solvers["rattle"]
    assert Sources(ROOT, keep).digest_modules("solvers/rattle") == whole.solvers["rattle"]  # from what is kept
