"""The meaning of every column: tables of a run, of a point solution, and the logs that come in as CSV.

``page.columns_page`` makes ``COLUMNS.md`` of it; a test compares it with the tables that a replay really gives.
"""
