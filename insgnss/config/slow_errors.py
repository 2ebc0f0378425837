"""Sizes of slowly varying range errors: orbits, clocks, and residuals of the atmosphere models."""

from __future__ import annotations

from typing import Final

from pydantic import Field

from insgnss.config.quantities import Constellation, NotNegative, Positive
from insgnss.config.strict import StrictModel


class SlowErrorSizes(StrictModel):
    """One sigma and correlation time of slowly varying range errors: in ``sd_*``, or states (``range_bias_states``).

    Ranging errors of the broadcast messages are of the size that the systems' performance reports give (GPS 0.5 m,
    Galileo 0.3 m rms); the broadcast ionosphere leaves about half of the delay.
    """

    satellite_m: dict[Constellation, NotNegative] = Field(
        {"G": 0.5, "E": 0.3, "C": 0.7, "J": 0.7, "R": 2.0, "I": 1.5, "S": 3.0},
        description="orbit and clock of the message, along the line of sight",
    )
    precise_satellite_m: NotNegative = Field(0.05, description="the same with SP3 orbits and clocks")
    ionosphere_zenith_m: NotNegative = Field(
        1.5, description="residual of the ionosphere model at the zenith on L1"
    )
    no_ionosphere_zenith_m: NotNegative = Field(
        5.0, description="the same without a model, or without its coefficients"
    )
    ionosphere_gradient_per_1000_km: NotNegative = Field(
        0.6, description="gradient of the zenith error, to the north and to the east"
    )
    troposphere_zenith_m: NotNegative = Field(
        0.05, description="residual of the troposphere model at the zenith"
    )
    with_base_share: NotNegative = Field(
        0.1, description="factor on all of these with corrections of a base station"
    )
    satellite_time_s: Positive = Field(3600.0, description="correlation time of a satellite's error")
    air_time_s: Positive = Field(3600.0, description="correlation time of the errors at the zenith")
    ionosphere_wander_m_per_sqrt_s: NotNegative = Field(
        0.005,
        description="largest random walk of the ionosphere's zenith error between epochs of carrier phases",
    )


NO_SLOW_ERRORS: Final = SlowErrorSizes(
    satellite_m={"G": 0.0},
    precise_satellite_m=0.0,
    ionosphere_zenith_m=0.0,
    no_ionosphere_zenith_m=0.0,
    ionosphere_gradient_per_1000_km=0.0,
    troposphere_zenith_m=0.0,
)
