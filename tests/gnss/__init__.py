"""Tests of ``insgnss.gnss``."""
