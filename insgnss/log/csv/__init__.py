"""Readers and writers of CSV tables: dialects, times, cells, columns."""
