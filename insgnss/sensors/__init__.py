"""A vehicle's further sensors and constraints besides IMU and GNSS receiver, as rows and states of the filter.

Each kind is a ``Measurement`` (``filter.own_rows.rows``), which says at which times it has rows and what they are in
terms of the state, and the ``StateBlock`` of its own errors. ``fitting`` makes them from a flight file.
"""
