"""How a filter begins: fix, level, a bank of headings to choose from, the validation of a given start."""
