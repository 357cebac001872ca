"""From numbers to what people read: the one place for tables, result files, figures, pages and provenance.

| module | what it holds |
|---|---|
| `table` | `Table`: values with units and formats; as files, Markdown, LaTeX, terminal text and HTML cells |
| `figure` | `panels`: a matplotlib figure as PNG; `Picture`: a titled PNG for a page, with SVG and PDF for papers |
| `page` | HTML pages from the templates in `scenarios/data/templates` |
| `provenance` | versions, machine and source that a result was made with |
"""
