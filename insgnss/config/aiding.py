"""The schema of loop aiding: for which satellites and carriers, how often, how differentiated, and the assumptions."""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from insgnss.config.quantities import Constellation, NotNegative, Positive
from insgnss.config.strict import StrictModel
from insgnss.errors import ConfigError

# The carrier of each constellation whose loops are aided: the one that the most receivers track first
DEFAULT_SIGNALS: Final[dict[Constellation, str]] = {
    "G": "C1C",
    "E": "C1C",
    "J": "C1C",
    "C": "C2I",
    "R": "C1C",
    "I": "C5A",
    "S": "C1C",
}


class AidingConfig(StrictModel):
    """The outputs of the loop aiding."""

    rate_hz: Positive = Field(50.0, description="outputs per second, at most one per inertial sample")
    signals: dict[Constellation, str] = Field(
        DEFAULT_SIGNALS, description="RINEX code of the carrier aided; a constellation left out is not aided"
    )
    horizon_deg: Annotated[float, Field(ge=-90.0, lt=90.0)] = Field(
        0.0, description="satellites above this elevation are predicted, tracked or not"
    )
    receiver_clock: bool = Field(
        True,
        description="include clock and drift of the receiver in pseudorange, Doppler and code delay rate",
    )
    latency_s: NotNegative = Field(
        0.0,
        description="delay from the inertial sample to the use: values and sigmas are those at the time of use",
    )
    slope_samples: Annotated[int, Field(ge=1, le=50)] = Field(
        2,
        description="number of samples over which rates and forces are differenced: more lower the noise and add delay",
    )
    sigma_interval_s: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        1.0,
        description="interval at which satellites, delays and sigmas are recomputed; in between the sigmas of rate"
        " and Doppler grow only by accelerometer noise and clock random walk",
    )
    # The jerk that a loop must withstand between sample and use: 0.5 g within a second, a car or a transport aircraft
    jerk_sigma_mps3: NotNegative = Field(
        5.0, description="jerk of the vehicle, by which the predicted sigmas grow with latency"
    )
    # Of position, rate and acceleration along the line of sight: URA of a healthy GPS satellite, and half of the
    # 95 % limits on URRE and URAE [GPS SPS Performance Standard 2020, table 3.4-2]
    satellite_range_sigma_m: NotNegative = Field(
        2.0, description="error of the satellite position and clock along the line of sight"
    )
    satellite_rate_sigma_mps: NotNegative = Field(0.003, description="the same for the range rate")
    satellite_acceleration_sigma_mps2: NotNegative = Field(
        0.001, description="the same for the radial acceleration"
    )
    # Over which the drift's random walk counts as a rate of the Doppler: the memory of a narrow carrier loop
    clock_averaging_s: Positive = Field(1.0, description="averaging time of the receiver clock's drift")


def aiding_config(wanted: float | AidingConfig, usual: AidingConfig) -> AidingConfig:
    """Return the settings that are asked for: all of them, or a rate [Hz] and the rest as usual.

    Raises
    ------
    ConfigError : it is not a rate
    """
    if isinstance(wanted, AidingConfig):
        return wanted
    try:
        rate_hz = float(wanted)
    except (TypeError, ValueError):
        rate_hz = math.nan
    if not 0.0 < rate_hz <= 1e5:
        raise ConfigError(
            f"invalid aiding rate {wanted!r}", key="aiding", advice="give a rate in Hz, as in 50"
        )
    return usual.model_copy(update={"rate_hz": rate_hz})
