"""Campaigns: grids of cases over processes or a cluster."""
