"""What a receiver study may change, and the sky that it has unless another is given."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final

from insgnss.simulation.closed_loop_sky import GPS_RADIUS_M

# eight satellites well spread, two of them low
AZIMUTH_DEG: Final = (20.0, 65.0, 110.0, 155.0, 200.0, 245.0, 290.0, 335.0)
ELEVATION_DEG: Final = (12.0, 40.0, 20.0, 65.0, 15.0, 35.0, 70.0, 25.0)
AVERAGED_S: Final = 40.0
LONGEST_WAIT_S: Final = 120.0  # for errors to settle after the fall of C/N0


@dataclass(frozen=True)
class ReceiverOptions:
    """Options of a receiver study. Seconds, hertz, chips."""

    # of the runs, settling included; None: AVERAGED_S from the start of the average on, as far as the motion allows;
    # past emitters to its end
    duration_s: float | None = None
    settle_s: float = 40.0  # until C/N0 falls
    # from which second of a run errors are averaged, as settle_s: from the fall on; None: when they have settled
    average_s: float | None = None
    step_s: float = 5e-3  # T, an integration
    interval_s: float = 0.1  # T_n, between two updates of a second stage
    imu_rate_hz: float | None = None  # None: a sample for every integration
    latency_s: float = 0.0  # after the end of an inertial sample until it is known
    imu_gaps_s: tuple[tuple[float, float], ...] = ()  # begin and end of times without inertial samples
    symbol_s: float = 20e-3  # of the data: no integration is longer; inf for a pilot
    carrier_hz: float = 1575.42e6
    chip_hz: float = 1.023e6
    spacing_chips: float = 1.0  # early to late
    phase_kind: str = "iq"
    least_cn0_dbhz: float | None = None  # a channel below it is not used: its lock detector says no
    told_cn0_dbhz: float | None = None  # the receiver takes this C/N0 for true; None: it knows the true one
    # channels of satellites that the antennas do not see at the filter's attitude are not used
    masking: bool = False
    estimates_cn0: bool = False  # the receiver estimates C/N0 over up to a second instead of knowing it
    cn0_estimator: str = "power"  # or "moments", which uses no noise level in windows from 0.2 s on
    azimuth_deg: tuple[float, ...] = AZIMUTH_DEG
    elevation_deg: tuple[float, ...] = ELEVATION_DEG
    orbit_radius_m: float = GPS_RADIUS_M
    divergence_density: float = 0.0  # by which phase and code ranges wander apart [m^2/s]: the ionosphere
    # in which an oscillator sets the replica's range: the wavelength over its phases ...
    replica_step_m: float = 0.0
    # ... and rate: the wavelength times its step of frequency; 0: no steps
    replica_step_mps: float = 0.0
    unknown_mps2: float = 49.03  # acceleration of a receiver without INS: one sigma of each axis ...
    unknown_s: float = 1.0 / 0.3  # ... and its correlation time

    def told(self) -> dict[str, Any]:
        """Return the options as plain values."""
        values = asdict(self)
        return values | {"symbol_s": self.symbol_s if math.isfinite(self.symbol_s) else "inf"}
