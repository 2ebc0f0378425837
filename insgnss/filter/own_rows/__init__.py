"""A user's own measurements: their interface, their view of the filter, and their ledger."""
