"""RTCM 3 streams."""
