"""Compiled functions: the decorator, its cache, and records that they and mypy both read."""
