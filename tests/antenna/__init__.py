"""Tests of ``insgnss.geodesy``."""
