"""Pages that people open in a browser."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """Collects what a browser would load or run, and checks that tags are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag not in ("script", "iframe", "object", "embed")
        if tag not in ("meta", "link", "img"):
            self.open.append(tag)
        self.loaded += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def require_self_contained(text: str) -> None:
    """Fail if a page loads anything from elsewhere, runs anything, or leaves a tag open."""
    page = Page(text)
    assert not page.open
    assert page.loaded
    assert all(address.startswith("data:") for address in page.loaded)
    assert "url(" not in text
    assert "@import" not in text
