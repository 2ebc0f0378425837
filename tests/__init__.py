"""Tests of insgnss. Shared pieces: ``jacobian``, ``statistics_bounds``, ``kernels``."""
