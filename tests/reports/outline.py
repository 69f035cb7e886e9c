"""A page as tests read it: its tags with attributes, its text outside of scripts."""

from html.parser import HTMLParser


class Outline(HTMLParser):
    """``tags``: name and attributes in order; ``text``: what a reader sees."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._text: list[str] = []
        self._inside: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self._inside.append(tag)

    def handle_endtag(self, tag):
        if self._inside and self._inside[-1] == tag:
            self._inside.pop()

    def handle_data(self, data):
        if not self._inside:
            self._text.append(data)

    @property
    def text(self) -> str:
        return "".join(self._text)

    @property
    def plain(self) -> str:
        """The text with one blank between words, also where only a tag is."""
        return " ".join(" ".join(self._text).split())
