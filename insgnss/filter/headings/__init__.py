"""The bank of headings: which are still different, and which motion has told them apart."""
