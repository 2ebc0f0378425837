"""One GNSS epoch in the compiled filter: which of its rows count, and their information."""
