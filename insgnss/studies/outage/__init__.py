"""The outage study."""
