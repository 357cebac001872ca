"""What all results share, be they of evaluations, studies, experiments or regression tests.

`store` keeps them in files, `provenance` says what they were made with, `interval` is an estimate with its confidence,
`table` presents them, and `page` draws a page of them.
"""
