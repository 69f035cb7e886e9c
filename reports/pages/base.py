"""Define the parts of a page of the report's site, and all that a page module needs to know.

A module of a folder in ``reports/pages/`` with a function ``write(results, site) -> Page | None`` is called once
(``RANK`` of the module, 0 without one, puts it later). It adds its page to the site and returns it, or returns None.
If the module also has ``write_variant(results, site, variant)``, that is called before for each variant, in another
process, with a ``site`` that knows no other page; what it returns is ``site.parts[<module>][<slug>]`` then ::

    page = Page("Claims", "claims.html", nav=True, order=20)
    return site.write(page, "claims.html", claims=found, plots=[...], scripts=[site.write_data("x", {}), "assets/x.js"])

Its template extends ``base.html`` and fills ``{% block main %}``. Templates are rendered after all modules have run:

- ``url(x)``: address of a run, a variant or a solver's name from the top folder, which ``{{ root }}`` leads to;
  ``exists("theatre-chain.html")``. A page ``about`` a variant's slug, a solver or a run is linked from its page.
- ``{% import "marks.html" as marks with context %}``: elements that pages share, such as ``marks.status(run)`` and
  ``marks.plot(p)`` for each of ``plots`` inside ``<div class="plots">``, after ``marks.plots_bar()``.
- ``term(name, shown)`` of the glossary; ``num(value, show)``: a table's cell that sorts by its value;
  ``looks[solver].colour``; the functions of reports/model/words.py.

``site.write_data(name, value)`` writes ``data/<name>.js``, which sets ``window.MBS[name]``, with NaN as null;
``site.write_bundle`` writes it deflated, for ``await MBS.unpack(MBS[name])``, where ``MBS.numbers(x)`` makes an array a
list. Scripts are classic, deferred and in the order given: opened from a disk, neither modules nor ``fetch`` work.
"""

import contextlib
import importlib
import multiprocessing
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from ...harness.base.confined_paths import ConfinedPath
from ...harness.base.files import FileError
from ...harness.results.judgements import files
from ...harness.results.judgements.files import PUBLISHED, File, read_judgement
from ..model.columns import list_page_columns
from ..model.frontier import Frontier, find_frontiers
from ..model.heat import HeatMap, make_heat_map
from ..model.results import (
    StoredResults,
    StoredRun,
    Variant,
    forget_series,
    format_stamp,
    group_by,
    list_recorded_packages,
    make_slug,
)
from ..model.scores import count_outcomes
from ..plots.browser import format_bundle, format_script, shorten_plots
from ..plots.spec import LineStyle, Plot, choose_styles, group_by_family
from ..rendering import FOLDER, load_templates, render

ASSETS = FOLDER / "assets"
PLOTTING = ("assets/plots.js",)
JUDGE = "mbsbench judge"
WRITTEN = "written"  # the data file, written last, with the number of runs of a complete report
PROCESSES = 2  # beside this one
JUDGEMENTS = 12  # judgement files in the cache: those of the results and the published ones
T = TypeVar("T")


def copy_assets(folder: ConfinedPath, names: Sequence[str]) -> None:
    """Copy the named scripts and styles into ``assets/`` of a report."""
    for name in names:
        (folder / "assets" / name).write((ASSETS / name).read_bytes(), durable=False)


@dataclass(frozen=True)
class Page:
    """A page; ``file`` is its path in the report, ``nav`` puts it into the navigation, smallest ``order`` first."""

    title: str
    file: str
    nav: bool = False
    order: int = 50
    about: str = ""
    brief: bool = False  # its footer has the main facts and a link to the first page's, as in subfolders

    @property
    def root(self) -> str:
        """The relative path to the report folder."""
        return "../" * self.file.count("/")


Pending = dict[str, tuple[Page, str, dict[str, Any]]]  # by file: the page, its template and the template's values


@dataclass
class Site:
    """The report folder while its pages are written."""

    results: StoredResults
    folder: ConfinedPath
    drawn: dict[str, str] = field(default_factory=dict)  # by run: the variant whose data file holds its curves
    # by variant: error over CPU time, in the data file of the cost page
    work: dict[str, Plot] = field(default_factory=dict)
    scenes: dict[str, dict[str, Any]] = field(default_factory=dict)  # by variant: its stage with the words beside it
    cards: dict[str, Any] = field(default_factory=dict)  # by solver: its certificate card
    pending: Pending = field(default_factory=dict)
    # by module with ``write_variant`` and by variant: what that returned
    parts: dict[str, dict[str, Any]] = field(default_factory=dict)

    def write(
        self,
        page: Page,
        template: str,
        scripts: Sequence[str] = (),
        plots: Sequence[Plot] = (),
        borrowed: str = "",
        **values: Any,
    ) -> Page:
        """Add a page to the site and return it; ``finish`` renders its ``template`` with ``values``.

        ``plots`` are drawn from a data file of the page's own, which is written at once; ``borrowed`` names a data file
        of another page whose plots this one shows too. ``scripts`` are loaded after those.
        """
        if plots or borrowed:
            name = "plots-" + page.file.removesuffix(".html").replace("/", "-")
            own = [self.write_bundle(name, shorten_plots(plots, self.looks))] if plots else []
            scripts = [*own, *([f"data/{borrowed}.js"] if borrowed else []), *PLOTTING, *scripts]
            values["plots_data"] = name
        self.add_pages({page.file: (page, template, {"scripts": scripts, "plots": list(plots), **values})})
        return page

    def add_pages(self, pages: Pending) -> None:
        """Add pages to be rendered; raise ValueError if two have the same file."""
        for file in pages.keys() & self.pending.keys():
            raise ValueError(f"two pages want to be {file}: {self.pending[file][0].title}, {pages[file][0].title}")
        self.pending |= pages

    def write_data(self, name: str, value: Any, form: Callable[[str, Any], str] = format_script) -> str:
        """Write ``data/<name>.js``, which sets ``window.MBS[name]`` to ``value``, and return its path for ``scripts``.

        ``form`` makes the script from name and value: plain JSON or, for ``format_bundle``, deflated.
        """
        (self.folder / "data" / f"{name}.js").write(form(name, value), durable=False)
        return f"data/{name}.js"

    def write_bundle(self, name: str, value: Any) -> str:
        """Write ``value``, nested data whose leaves may be arrays, deflated to ``data/<name>.js``; return its path.

        In a page ``await MBS.unpack(MBS[name])`` returns the data, and ``MBS.numbers`` makes one of its arrays a list.
        """
        return self.write_data(name, value, format_bundle)

    def url(self, about: StoredRun | Variant | str) -> str:
        """Return the address of the page of a run, a variant or a solver, from the report folder."""
        if isinstance(about, StoredRun):
            return address_run(about)
        if isinstance(about, Variant):
            return f"problem-{about.slug}.html"
        return self._solver_urls[about]

    @cached_property
    def frontiers(self) -> list[Frontier]:
        """The cheapest solvers for every error on every problem."""
        return find_frontiers(self.results)

    @cached_property
    def heat_map(self) -> HeatMap | None:
        """The solvers by the problems of the plain comparison; None without any."""
        return make_heat_map(self.results)

    @cached_property
    def looks(self) -> dict[str, LineStyle]:
        """The colour and marker by solver, the same on every page."""
        return choose_styles(self.results.solvers)

    def pages(self) -> list[Page]:
        """Return all pages added so far, those of the navigation first."""
        return sorted((p for p, _, _ in self.pending.values()), key=lambda p: (not p.nav, p.order, p.title))

    def load_templates(self) -> None:
        """Compile the templates of the pages added so far, for the process that is forked to render half of them."""
        load_templates(template for _, template, _ in self.pending.values())

    def finish(self) -> None:
        """Render all pages and write them, with the navigation and the values that all templates know.

        A forked process renders every second page meanwhile.
        """
        self.load_templates()
        shared = self._collect_shared_values()
        nav = [p for p in self.pages() if p.nav]
        self.write_data("pages", [[p.title, p.file] for p in nav if p.file != "index.html"])
        with ProcessPoolExecutor(1, multiprocessing.get_context("fork"), _keep_inherited, (self, shared, nav)) as pool:
            beside = pool.submit(_render_half)
            self.render_pages(0, shared, nav)
            beside.result()

    def render_pages(self, first: int, shared: Mapping[str, Any], nav: Sequence[Page]) -> None:
        """Render and write every second page, beginning with that of index ``first``, 0 or 1.

        ``shared`` are the values that all templates know, ``nav`` the pages of the navigation.
        """
        for page, template, values in list(self.pending.values())[first::2]:
            scripts = ["assets/site.js", *(["data/pages.js"] if page.root else []), *values["scripts"]]
            given = {**shared, **values, "scripts": scripts, "page": page, "root": page.root, "pages": nav}
            (self.folder / page.file).write(render(template, **given), durable=False)

    @cached_property
    def _solver_urls(self) -> Mapping[str, str]:
        """The address of the page of each solver, by name."""
        taken: set[str] = set()
        return {name: f"solver-{make_slug(name, taken)}.html" for name in self.results.solvers}

    def _collect_shared_values(self) -> dict[str, Any]:
        """Return the values and functions that every template may use."""
        results, slugs = self.results, {p.title: p.slug for p in self.results.variants}
        related = group_by(self.pages(), lambda p: p.about)
        drifts = read_judged(results.folder, files.DRIFTS).found or ()
        return {
            "results": results,
            "looks": self.looks,
            "url": self.url,
            "exists": self.pending.__contains__,
            "run_title": results.environment.get("results_folder") or results.folder.name,
            "stamp": format_stamp(results),
            "packages": list_recorded_packages(results),
            "drifts_of": lambda variant: [d for d in drifts if d.variant == variant.title],
            "page_columns": list_page_columns,
            "score_of": count_outcomes,
            "slug_of": lambda run: slugs[run.variant],
            "related": lambda about: related.get(about, []),
            "families": group_by_family(self.looks),
        }


def load_page_modules() -> list[ModuleType]:
    """Return the page modules in the order of their calls: smallest ``RANK`` first (0 without one), then by name."""
    found = pkgutil.walk_packages([str(FOLDER / "pages")], f"{__package__}.")
    modules = [m for m in (importlib.import_module(m.name) for m in found) if hasattr(m, "write")]
    return sorted(modules, key=lambda m: (getattr(m, "RANK", 0), m.__name__))


def write_pages(site: Site, await_judgement: Callable[[], None] = lambda: None) -> None:
    """Call every page module, which adds its pages to the site; pages of variants come from two more processes.

    A variant is the task of one process, which reads its series once for all modules. ``await_judgement`` is called
    while variants are written, which need no judgement, and returns when it is there. Modules with a ``RANK`` above 0
    or a function ``write_variant`` are called last.
    """
    modules = load_page_modules()
    by_variant = [m for m in modules if hasattr(m, "write_variant")]
    late = {m.__name__ for m in modules if m in by_variant or getattr(m, "RANK", 0) > 0}
    _ = site.frontiers, site.heat_map  # found here once: the processes inherit them
    order = sorted(range(len(site.results.variants)), key=lambda k: -len(site.results.variants[k].runs))
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("fork"), _keep_inherited, (site,)) as pool:
        beside = {k: pool.submit(_write_variant_pages, k, tuple(m.__name__ for m in by_variant)) for k in order}
        try:
            await_judgement()
            _call_modules([m for m in modules if m.__name__ not in late], site)
            site.load_templates()  # here and below while the others are busy
            for k, variant in enumerate(site.results.variants):
                written = beside[k].result()
                site.add_pages(written.pending)
                site.load_templates()
                site.scenes |= written.scenes
                site.drawn |= written.drawn
                for name, part in written.parts.items():
                    site.parts.setdefault(name, {})[variant.slug] = part
        except BaseException:  # such as an interruption: no other variant is begun
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    _call_modules([m for m in modules if m.__name__ in late], site)
    forget_series()


@dataclass(frozen=True)
class VariantPages:
    """The pages of one variant, its stage and curves, and what each module returned for it."""

    pending: Pending
    scenes: dict[str, dict[str, Any]]
    drawn: dict[str, str]
    parts: dict[str, Any]


_inherited: list[Any] = []  # in a process of a pool: the site, and what else its tasks share


def _keep_inherited(*values: Any) -> None:
    """Store in ``_inherited`` what the tasks of this forked process share."""
    _inherited[:] = values


def _render_half() -> None:
    """Render the second half of the pages of the inherited site."""
    site, shared, nav = _inherited
    site.render_pages(1, shared, nav)


def _write_variant_pages(k: int, modules: Sequence[str]) -> VariantPages:
    """Write the pages of the variant with index ``k``, in a process of the pool, and return them to the main process.

    ``modules`` are the names of the page modules that have a function ``write_variant``. The inherited site is emptied
    first, so that only what they add for this variant is returned.
    """
    site: Site = _inherited[0]
    site.pending, site.scenes, site.drawn = {}, {}, {}
    variant = site.results.variants[k]
    parts = {name: importlib.import_module(name).write_variant(site.results, site, variant) for name in modules}
    forget_series()
    return VariantPages(site.pending, site.scenes, site.drawn, parts)


def _call_modules(modules: Sequence[ModuleType], site: Site) -> None:
    """Call these page modules, which add their pages to the site."""
    for module in modules:
        module.write(site.results, site)


@dataclass(frozen=True)
class JudgementFile(Generic[T]):
    """The content of one judgement file, or the reason why there is none.

    ``published`` is the reason why the content belongs to the published results.
    """

    found: T | None = None
    why: str = ""
    published: str = ""


def read_judged_or_published(results: Path, file: File[T]) -> JudgementFile[T]:
    """Read the judgement of a results folder, or else the published one with the reason why.

    A damaged file of the folder is reported, not replaced.
    """
    own = read_judged(results, file)
    broken = own.found is None and (ConfinedPath(results) / files.FOLDER / f"{file.name}.json").is_there()
    if own.found or broken:
        return own
    kept = read_or_explain(PUBLISHED, file, f"{JUDGE} --publish")
    why = own.why or "These results hold no runs to judge it from."
    return JudgementFile(kept.found, published=why) if kept.found else own


def read_judged(results: Path, file: File[T]) -> JudgementFile[T]:
    """Read ``judgement/<name>.json`` of a results folder, or explain why it cannot be read."""
    return read_or_explain(ConfinedPath(results) / files.FOLDER, file, f"{JUDGE} {results.name}")


def read_or_explain(folder: ConfinedPath, file: File[T], command: str) -> JudgementFile[T]:
    """Read a judgement in ``folder``, or explain why there is none and name the ``command`` that creates it."""
    try:
        return JudgementFile(_read_once(file, folder, _find_age(folder / f"{file.name}.json")))
    except FileNotFoundError:
        return JudgementFile(why=f"There is no {folder.name}/{file.name}.json yet. To make it: {command}")
    except FileError as error:
        return JudgementFile(why=f"{error}. To make it anew: {command}")


@lru_cache(JUDGEMENTS)
def _read_once(file: File[T], folder: ConfinedPath, age: tuple[int, int]) -> T:
    """Read a judgement once for all pages; ``age`` is part of the cache's key, so that a changed file is read again."""
    return read_judgement(file, folder)


def _find_age(place: ConfinedPath) -> tuple[int, int]:
    """Return when a file was written [ns], and its size [bytes]; zeros where there is none."""
    with contextlib.suppress(OSError):
        found = place.path.lstat()
        return found.st_mtime_ns, found.st_size
    return 0, 0


def address_run(run: StoredRun) -> str:
    """Return the address of a run's page."""
    return f"runs/{run.record.run_id}.html"
