"""Septentrio SBF files."""
