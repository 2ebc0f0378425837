"""GLONASS: a delay of the receiver that grows with the frequency channel [m per channel]."""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import StateBlock
from insgnss.filter.states.wanted import StateInputs

CHANNEL_BIAS: Final = "glonass_channel_bias"


def glonass_channel_bias(wanted: StateInputs) -> StateBlock | None:
    """Return the block, a constant of the receiver; None without GLONASS or where it is switched off."""
    if not ("R" in wanted.clock_groups and wanted.config.measurements.glonass_channel_bias):
        return None
    sigma = wanted.config.process.channel_bias_sigma_m
    return StateBlock(CHANNEL_BIAS, ("glonass_bias_m_per_channel",), "m per channel", sigma)
