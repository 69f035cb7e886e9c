"""Write figures and tables as LaTeX floats with captions and labels, to copy or to input."""

from collections.abc import Mapping, Sequence
from typing import Any

from .tables import escape_latex

MATHS = {  # characters that pdfLaTeX sets in math mode only; a letter with an accent comes before the letter
    "φ̇": r"$\dot\phi$",
    "φ": r"$\phi$",
    "Δ": r"$\Delta$",
    "₀": "$_0$",
    "≈": r"$\approx$",
    "≤": r"$\le$",
    "×": r"$\times$",
    "★": r"$\star$",
    "−": "$-$",
    "⁻": "$^{-}$",
    **{c: f"$^{k}$" for k, c in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")},
}
HEAD = r"""% Floats of %s: needs \usepackage{graphicx,booktabs,array}. Copy what is wanted, or
%% \newcommand{\publication}{path/of/this/folder} and \input{\publication/floats} for all of them.
\providecommand{\publication}{.}
"""


def format_latex_caption(text: str) -> str:
    """Return a caption with its symbols in math mode; other characters are kept."""
    out = escape_latex(text)
    for symbol, latex in MATHS.items():
        out = out.replace(symbol, latex)
    return out


def format_floats(title: str, figures: Sequence[Mapping[str, Any]], tables: Mapping[str, str]) -> str:
    """Return the LaTeX code of all floats.

    ``figures`` are entries of captions.json; ``tables`` maps paths without suffix to captions.
    """
    out = [HEAD.replace("%s", escape_latex(title), 1).replace("%%", "%")]
    for place, caption in tables.items():
        name = place.rpartition("/")[2]
        out.append(rf"""\begin{{table}}[tb]
  \centering
  \caption{{{format_latex_caption(caption)}}}\label{{tab:{name}}}
  \input{{\publication/{place}.tex}}
\end{{table}}
""")
    for f in figures:
        file = next(name for name in f["files"] if name.endswith(".pdf"))
        star = "*" if f["width_mm"] > 100.0 else ""  # over both columns
        out.append(rf"""\begin{{figure{star}}}[tb]
  \centering
  \includegraphics[width={f["width_mm"]}mm]{{\publication/{file}}}
  \caption{{{format_latex_caption(f["caption"])}}}\label{{fig:{f["name"]}}}
\end{{figure{star}}}
""")
    return "\n".join(out)
