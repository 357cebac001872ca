"""From numbers to what people read: the one place for tables, result files, figures, pages and provenance.

| module | what it holds |
|---|---|
| `table` | `Table`: a DataFrame with units and number formats; as files, Markdown, terminal text and HTML cells |
| `figure` | `panels`: a matplotlib figure as PNG; `Picture`: a titled PNG for a page |
| `page` | HTML pages from the templates in `scenarios/data/templates` |
| `provenance` | versions, machine and source that a result was made with |
"""
