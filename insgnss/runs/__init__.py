"""The jobs and their results: replay, engine, point, check, simulate, visibility, margin; result tables."""
