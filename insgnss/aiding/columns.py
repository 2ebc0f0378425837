"""The columns of the aiding that are made of others, in one pass: a table has millions of rows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.aiding.observables import Float32, Spans, Values
from insgnss.aiding.uncertainty import (
    SD_ACCELERATION,
    SD_DOPPLER,
    SD_DOPPLER_RATE,
    SD_JERK,
    SD_RANGE,
    SD_RATE,
    UncertaintyTerms,
)
from insgnss.constants import C_MPS
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int16


class AidingColumns(NamedTuple):
    """Columns of ``aiding.table``, one entry for each output time and satellite of its span."""

    time_s: Float64
    sv: Int16
    range_rate_mps: Float64
    doppler_hz: Float64
    doppler_rate_hz_per_s: Float32
    pseudorange_m: Float64
    code_delay_rate_s_per_s: Float64
    sd_range_rate_mps: Float32
    sd_range_acceleration_mps2: Float32
    sd_range_jerk_mps3: Float32
    sd_doppler_hz: Float32
    sd_doppler_rate_hz_per_s: Float32
    sd_pseudorange_m: Float32
    sd_code_delay_rate_s_per_s: Float32


class Times(NamedTuple):
    """When the values of n times are used, and what they start from."""

    used_s: Float64  # (n,) [s of the week]
    since_s: Float64  # (n,) from the time of the span's sigma [s]
    receiver_drift: Float64  # (n,) [m/s], zero where the receiver's clock is out


def new_columns(n: int) -> AidingColumns:
    """Return columns of ``n`` entries, to be filled."""
    doubles: list[Float64] = [np.empty(n) for _ in range(5)]
    singles: list[Float32] = [np.empty(n, np.float32) for _ in range(8)]
    time, rate, doppler, pseudorange, code = doubles
    return AidingColumns(
        time, np.empty(n, np.int16), rate, doppler, singles[0], pseudorange, code, *singles[1:]
    )


@kernel
def fill_columns(
    spans: Spans,
    values: Values,
    sigma: npt.NDArray[np.float32],
    times: Times,
    per_cycle: Float64,
    doubts: UncertaintyTerms,
    out: AidingColumns,
) -> None:
    """Write all columns, at the time of use.

    Equation: rate + acceleration L, pseudorange + rate L + acceleration L^2 / 2, L the latency; the jerk is too noisy
    to be used. Since sigma were found, the noise of the accelerometers and the walk of the clock's drift have gone on:
    var(rate) += q_a t, var(Doppler) += (q_a + q_drift) t.

    Parameters
    ----------
    spans, values : as ``observables.fill_values`` leaves them
    sigma : (q, N_SIGMA) of each span's satellites
    per_cycle : (s,) 1 / wavelength of each satellite [1/m]
    """
    lag, rate_density = doubts.latency_s, doubts.accel_density
    drift_density = doubts.receiver_clock * doubts.drift_density
    row = 0
    for span in range(len(spans.first_time) - 1):
        first, end = spans.first_satellite[span], spans.first_satellite[span + 1]
        for i in range(spans.first_time[span], spans.first_time[span + 1]):
            of_rate, of_doppler = (
                rate_density * times.since_s[i],
                (rate_density + drift_density) * times.since_s[i],
            )
            for j in range(first, end):
                satellite = spans.satellite[j]
                cycles, drift = per_cycle[satellite], times.receiver_drift[i] - spans.drift_mps[j]
                now, acceleration = values.range_rate[row], values.acceleration[row]
                rate = now + lag * acceleration
                code = rate + drift
                out.time_s[row], out.sv[row] = times.used_s[i], satellite
                out.range_rate_mps[row] = rate
                out.doppler_hz[row] = -code * cycles
                out.doppler_rate_hz_per_s[row] = -acceleration * cycles
                out.pseudorange_m[row] = values.pseudorange[row] + lag * (
                    now + drift + 0.5 * lag * acceleration
                )
                out.code_delay_rate_s_per_s[row] = code / C_MPS
                sd_rate = math.sqrt(float(sigma[j, SD_RATE]) ** 2 + of_rate)
                sd_doppler = math.sqrt(float(sigma[j, SD_DOPPLER]) ** 2 + of_doppler)
                out.sd_range_rate_mps[row] = sd_rate
                out.sd_range_acceleration_mps2[row] = sigma[j, SD_ACCELERATION]
                out.sd_range_jerk_mps3[row] = sigma[j, SD_JERK]
                out.sd_doppler_hz[row] = sd_doppler * cycles
                out.sd_doppler_rate_hz_per_s[row] = sigma[j, SD_DOPPLER_RATE] * cycles
                out.sd_pseudorange_m[row] = sigma[j, SD_RANGE]
                out.sd_code_delay_rate_s_per_s[row] = sd_doppler / C_MPS
                row += 1
