"""Convert marks of the article's source to HTML and to LaTeX: *emphasis*, `code`, $equations$."""

import html
import re

EQUATION = re.compile(r"\$[^$\n]*\$")
GREEK = {
    r"\varphi": "φ",
    r"\lambda": "λ",
    r"\sigma": "σ",
    r"\mu": "μ",
    r"\Delta": "Δ",
    r"\,": " ",
    r"\bar ": "",
    r"\dot": "",
}
POWERS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def as_html(text: str) -> str:
    """Return a line of text with its marks in HTML."""

    def equation(m: re.Match[str]) -> str:
        own = m[0][1:-1]
        for tex, sign in GREEK.items():
            own = own.replace(tex, sign)
        return "<i>" + re.sub(r"_\{?(\w+)\}?", r"<sub>\1</sub>", own) + "</i>"

    out = EQUATION.sub(equation, html.escape(text, quote=False))
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", re.sub(r"\*([^*]+)\*", r"<em>\1</em>", out))


def as_latex(text: str) -> str:
    """Return a line of text with its marks in LaTeX; equations are unchanged."""

    def plain(own: str) -> str:
        own = re.sub(r"([&%#_{}$])", r"\\\1", own).replace("~", r"\textasciitilde{}")
        own = re.sub(r"×10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)", lambda m: f"$\\times 10^{{{m[1].translate(POWERS)}}}$", own)
        for sign, tex in {
            "−": "$-$",
            "∞": r"$\infty$",
            "≤": r"$\le$",
            "\u202f": r"\,",
            "|phi|": r"$|\varphi|$",
            "φ": r"$\varphi$",
        }.items():
            own = own.replace(sign, tex)
        return re.sub(r"`([^`]+)`", r"\\texttt{\1}", re.sub(r"\*([^*]+)\*", r"\\emph{\1}", own))

    parts = re.split(r"(\$[^$\n]*\$)", text)
    return "".join(part if k % 2 else plain(part) for k, part in enumerate(parts))
