"""NovAtel OEM files."""
