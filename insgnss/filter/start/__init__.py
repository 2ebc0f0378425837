"""How a filter begins: fix, level, a bank of headings to choose from, the trial of what was given."""
