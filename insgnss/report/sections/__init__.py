"""The sections of the report's page, one file each: a run in, a section out, or None where it has nothing for it."""
