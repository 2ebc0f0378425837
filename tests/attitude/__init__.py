"""Tests of ``insgnss.attitude``."""
