"""Layouts of the filter's further states for tests that need no log."""

from __future__ import annotations

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config, imu_grade
from insgnss.filter.layout import SYSTEM_OFFSETS, Layout, StateBlock
from insgnss.filter.states.glonass_channel_bias import glonass_channel_bias
from insgnss.filter.states.ionosphere import ionosphere as ionosphere_block
from insgnss.filter.states.wanted import StateInputs
from insgnss.filter.states.zenith_delay import zenith_delay as zenith_delay_block


def layout_with(
    n_offsets: int = 0,
    channel_bias: bool = False,
    zenith_delay: bool = False,
    ionosphere: bool = False,
    clone: bool = False,
    config: FilterConfig | None = None,
) -> Layout:
    """Return a layout with the blocks that are named."""
    config = config or filter_config("tight")
    config = config.model_copy(
        update={"measurements": config.measurements.model_copy(update={"zenith_delay": True})}
    )
    wanted = StateInputs(config, ("G", "R"), with_carrier=True, grade=imu_grade("tactical"))
    offsets = tuple(f"offset_{i}_m" for i in range(n_offsets))
    blocks = (
        StateBlock(SYSTEM_OFFSETS, offsets, "m", 3000.0) if offsets else None,
        glonass_channel_bias(wanted) if channel_bias else None,
        zenith_delay_block(wanted) if zenith_delay else None,
        ionosphere_block(wanted) if ionosphere else None,
    )
    return Layout(tuple(block for block in blocks if block is not None), clone)
