"""The masking study."""
