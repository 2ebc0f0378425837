"""The jobs and what they give: replay, engine, point, check, simulate, visibility, margin; result tables."""
