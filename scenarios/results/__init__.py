"""From numbers to what people read: figures, pages and provenance. Tables are `voxdepth.tools.table`.

| module | what it holds |
|---|---|
| `figure` | `panels`: a matplotlib figure as PNG; `Picture`: a titled PNG for a page |
| `page` | HTML pages from the templates in `scenarios/data/templates` |
| `provenance` | versions, machine and source that a result was made with |
"""
