"""HTML pages from templates; all that comes from outside is escaped."""

from typing import Any

from ..files import DATA


def render_page(template: str, **values: Any) -> str:
    """Return the text of a page; a value that the template needs and does not get is an error."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(DATA / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)
