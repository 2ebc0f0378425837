"""A user's own measurements: what they are asked, what they are shown of the filter, and their ledger."""
