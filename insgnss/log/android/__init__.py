"""Readers of Android GnssLogger files."""
