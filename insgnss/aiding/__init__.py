"""Loop aiding: what the tracking channels of a receiver should expect next, and how far to trust it."""
