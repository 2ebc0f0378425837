"""Tests of ``insgnss.tracking``."""
