"""The bank of headings: which are still distinct, and the motion that separated them."""
