"""u-blox UBX files."""
