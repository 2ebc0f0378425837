"""Every correction of a pseudorange, in one list: what is added to the geometric range, its sign, its size.

| term                     | sign | size               | where |
|--------------------------|------|--------------------|-------|
| Earth's turn (Sagnac)    | in the geometric range    | up to 40 m | ``line_of_sight`` |
| receiver clock           | +    | metres to 300 km   | filter state |
| inter-system offset      | +    | up to 1 km         | filter state, further constellations only |
| satellite clock          | -    | up to 300 km       | ``satellite_clock``, relativity and group delay in it |
| ionosphere               | +    | 2 to 50 m          | ``ionosphere``, scaled by (f_L1 / f)^2 |
| troposphere              | +    | 2.4 to 25 m        | ``troposphere`` |
"""

from __future__ import annotations

from insgnss.gnss.ionosphere import ionosphere_above, klobuchar_delay
from insgnss.gnss.troposphere import tropospheric_delay
from insgnss.jit import kernel
from insgnss.tables import Float64


@kernel
def path_delay(
    klobuchar: Float64,
    lat: float,
    lon: float,
    h: float,
    azimuth: float,
    elevation: float,
    week_s: float,
    ionosphere_factor: float,
    troposphere_factor: float,
) -> float:
    """Return the delay of a pseudorange by the atmosphere [m].

    Parameters
    ----------
    klobuchar : (8,) alpha 0..3, beta 0..3
    lat, lon, h : of the antenna [rad, rad, m]
    azimuth, elevation : of the satellite [rad]
    week_s : GPS seconds of the week
    ionosphere_factor : (f_L1 / f)^2 of the signal, zero for no correction
    troposphere_factor : one, or zero for no correction
    """
    delay = 0.0
    if ionosphere_factor > 0.0:
        vertical = klobuchar_delay(klobuchar, lat, lon, azimuth, elevation, week_s)
        delay += ionosphere_factor * ionosphere_above(h) * vertical
    if troposphere_factor > 0.0:
        delay += troposphere_factor * tropospheric_delay(lat, h, elevation)
    return delay
