"""Tests of ``insgnss.inertial``."""
