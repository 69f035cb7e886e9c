"""Hook into mkdocs.yml: the site has the files of the repository at their places, so that its links hold on both.

Pages are the Markdown of the top folder, of ``docs/`` and of the checker, the public names of ``mbsbench``, and the
table of verdicts, which is made from ``results/published/claims.json``.
"""

import re
from pathlib import Path

import list_verdicts  # type: ignore[import-not-found]  # beside this file
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import mbsbench

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)#\s]+)")
TABLE = re.compile(r"(?<=<!-- verdicts -->\n).*?(?=<!-- end of verdicts -->)", re.DOTALL)
TITLES = {  # of the pages on the public names
    "api": "Runs and results",
    "catalogue": "Entries and their options",
    "types": "Problems, motions and their status",
    "solvers": "Compiled equations",
}
CHECKER = "checker/README.md"  # its page is beside it, for both are copied together
HIDDEN = {".py", ".toml", ".j2"}  # of docs/, unless a page links to it


def on_files(given: Files, config: MkDocsConfig) -> Files:
    """Return the pages, the other files in docs/ and each file that a page links to; set ``config.nav``."""
    pages = [ROOT / "README.md", *sorted(p for p in ROOT.glob("*.md") if p.stem != "README")]
    pages += [*sorted((ROOT / "docs").rglob("*.md")), ROOT / CHECKER]
    linked = {(p.parent / link).resolve() for p in pages for link in LINK.findall(p.read_text(encoding="utf-8"))}
    beside = {p for p in (ROOT / "docs").rglob("*") if p.suffix not in HIDDEN and "__pycache__" not in p.parts}
    wanted = [*pages, *sorted({p for p in linked | beside if p.is_file() and p.is_relative_to(ROOT)} - {*pages})]
    files = [File(str(p.relative_to(ROOT)), str(ROOT), config.site_dir, config.use_directory_urls) for p in wanted]
    made = {f"api/{part}.md": _reference(part) for part in dict.fromkeys(m.split(".")[0] for m in mbsbench._HOMES)}
    files += [File.generated(config, path, content=text) for path, text in made.items()]
    groups = {"Guide": "docs/*.md", "Decisions": "docs/decisions/*.md", "Project": "[!R]*.md"}
    found = {title: [str(p.relative_to(ROOT)) for p in sorted(ROOT.glob(at))] for title, at in groups.items()}
    found["Guide"].append(CHECKER)
    config.nav = [{"Overview": "README.md"}, *({k: v} for k, v in found.items()), {"API": sorted(made)}]
    theme = [f for f in given if f.src_dir != config.docs_dir]
    return Files([*theme, *files])


def on_page_markdown(text: str, page: Page, **_: object) -> str:
    """Return the text with the table of verdicts, and with links to folders replaced by links to their first page."""
    place = (ROOT / page.file.src_uri).parent

    def target(found: re.Match[str]) -> str:
        folder = place / found[1]
        first = min(folder.glob("*.md"), default=None) if folder.is_dir() else None
        return f"{found[1].rstrip('/')}/{first.name}" if first else found[1]

    return LINK.sub(target, TABLE.sub(lambda _: list_verdicts.table(), text))


def _reference(part: str) -> str:
    """Return the page, in Markdown, of the public names that the modules of one ``part`` define."""
    text = [f"# {TITLES.get(part, part.capitalize())}\n"]
    for module, names in mbsbench._HOMES.items():
        path = module if part in ("api", "solvers") else f"harness.{module}"
        for name in names if module.split(".")[0] == part else ():
            text.append(f"::: {path}.{name}\n    options: {{heading: mbsbench.{name}, toc_label: {name}}}\n")
    return "\n".join(text)
