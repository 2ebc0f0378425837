"""The blocks of further states that the filter knows by itself, one file for each."""
