"""The receiver study: loops with and without aiding, closed with the filter."""
