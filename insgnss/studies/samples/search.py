"""Where a receiver on samples looks for a satellite: in the search supervisor's window, or everywhere."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.aiding.satellite_arcs import SatelliteArcs
from insgnss.aiding.table import AidingSetup, AidingTable
from insgnss.aiding.trace import Covariances, FilterTrace, Trace, TraceSamples
from insgnss.aiding.uncertainty import SD_DOPPLER, SD_RANGE
from insgnss.config.flight import GivenStart
from insgnss.config.sample_receiver import SampleReceiver
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.gnss.signals import L1_HZ
from insgnss.inertial.error_state import CLOCK, DR, DRIFT, DV, PSI
from insgnss.log.iq_file import IqFile
from insgnss.receiver import Outlook, SupervisionSetup, outlook
from insgnss.receiver.detection import threshold
from insgnss.receiver.search_window import SearchWindow
from insgnss.tables import Float64, ImuTable
from insgnss.tracking.acquisition import Acquisition, SearchSpan, acquire
from insgnss.tracking.admissible import require_not_negative
from insgnss.tracking.codes import GPS_BIT_S, GPS_CA_CHIP_HZ, RangingCode, gps_ca
from insgnss.tracking.signal import SignalSamples

# half width: the cells of the transform are a quarter of a chip, their noise is shared
LEAST_WINDOW_CHIPS = 1.0

GPS_ORBIT_PRNS: Final = range(1, 33)
FOUND, NOT_FOUND, CROSS_CORRELATION = "found", "not_found", "cross_correlation"
CROSS_CORRELATION_DB: Final = 15.0


class SignalPrediction(NamedTuple):
    """Prediction for each channel's satellite at a sample, (m,); NaN without one."""

    sample: float
    delay_m: Float64  # pseudorange
    doppler_hz: Float64
    doppler_rate_hz_per_s: Float64
    sd_delay_m: Float64
    sd_rate_mps: Float64

    def delay_at(self, channel: int, sample: float, rate_hz: float) -> float:
        """Return the pseudorange of a channel at another sample [m]."""
        since_s = (sample - self.sample) / rate_hz
        doppler = self.doppler_hz[channel] + 0.5 * self.doppler_rate_hz_per_s[channel] * since_s
        return float(self.delay_m[channel] - C_MPS / L1_HZ * doppler * since_s)


class SearchOutcome(NamedTuple):
    """The result of one search."""

    found: bool
    threshold: float
    acquired: Acquisition
    span: SearchSpan
    first_sample: int
    last_sample: int
    took_s: float

    def at_end(self, expected_delay_m: float, rate_hz: float) -> tuple[float, float]:
        """Return the pseudorange [s] and the Doppler [Hz] at the last sample.

        The whole code periods are those nearest to what is expected: it must be good to half a millisecond.
        """
        length_s = (self.last_sample - self.first_sample) / rate_hz
        doppler = self.acquired.doppler_hz
        delay = (self.acquired.delay_chips + origin_chips(self.first_sample, rate_hz)) / GPS_CA_CHIP_HZ
        delay -= doppler / L1_HZ * length_s
        period = 1023.0 / GPS_CA_CHIP_HZ
        delay += period * round((expected_delay_m / C_MPS - delay) / period)
        return delay, doppler + 0.5 * self.span.doppler_rate_hz_per_s * length_s


def origin_chips(first: int, rate_hz: float) -> float:
    """Return the code phase of a satellite without delay at a sample, from the beginning of a data bit on [chips]."""
    return GPS_CA_CHIP_HZ / rate_hz * first % (GPS_CA_CHIP_HZ * GPS_BIT_S)


def start_outlook(
    setup: AidingSetup, arcs: SatelliteArcs, start: GivenStart, imu: ImuTable, settings: SampleReceiver
) -> Outlook:
    """Return the supervisor's outlook before the first epoch: from the given start alone.

    Its covariance comes from the start for position, velocity and attitude, and from the settings for the clock.
    """
    r_e, C_ne, C_nb = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    lat, lon = math.radians(start.lat_deg), math.radians(start.lon_deg)
    geodetic_to_ecef(lat, lon, start.h_m, r_e)
    ecef_to_ned_matrix(lat, lon, C_ne)
    roll, pitch, yaw = (math.radians(a) for a in start.rpy_deg)
    euler_to_matrix(roll, pitch, yaw, C_nb)
    sd = np.zeros(DRIFT + 1)
    sd[DR : DR + 3], sd[DV : DV + 3] = start.sd_position_m, start.sd_velocity_mps
    sd[PSI : PSI + 3] = math.radians(start.sd_yaw_deg)
    sd[CLOCK], sd[DRIFT] = C_MPS * settings.time_sigma_s, settings.drift_sigma_mps
    t_ns = imu.t_ns[:1]
    none = np.zeros((1, 3))
    v_e = (C_ne.T @ np.array(start.v_ned_mps))[None, :]
    trace = Trace(
        t_ns, np.zeros(1, np.int64), r_e[None, :], v_e, (C_ne.T @ C_nb)[None], none, none,
        np.zeros((1, 2)), np.zeros((1, 0)),
    )  # fmt: skip
    filter_trace = FilterTrace(
        trace, Covariances(t_ns, np.diag(sd**2)[None]), TraceSamples(imu.t_ns, imu.w_ib_b, imu.f_b)
    )
    return outlook(SupervisionSetup(setup, search=settings.search), arcs, filter_trace)


def expected_at_start(view: Outlook, names: Sequence[str], sample: float) -> SignalPrediction:
    """Return the predictions for the channels' satellites from an outlook of one row, which has no Doppler rate."""
    column = {name: i for i, name in enumerate(view.sv_names)}
    p = view.predicted
    picked = [
        np.append(values[0], np.nan) for values in (p.delay_m, p.range_rate_mps, p.d_range_m2, p.d_rate_m2ps2)
    ]
    at = [column.get(name, -1) for name in names]
    delay, rate, d_range, d_rate = (values[at] for values in picked)
    return SignalPrediction(
        sample, delay, -rate * L1_HZ / C_MPS, np.zeros(len(at)), np.sqrt(d_range), np.sqrt(d_rate)
    )


def expected_by_aiding(
    table: AidingTable, names: Sequence[str], week: int, sample: float
) -> SignalPrediction:
    """Return the predictions for the channels' satellites from the aiding of one instant."""
    columns = table.columns(week)
    number = {name: i for i, name in enumerate(table.sv_names)}
    row = {int(sv): i for i, sv in enumerate(columns["sv"])}
    at = [row.get(number.get(name, -1), -1) for name in names]

    def column(values: npt.ArrayLike) -> Float64:
        return np.append(np.asarray(values, np.float64), np.nan)[at]

    return SignalPrediction(
        sample,
        column(columns["pseudorange_m"]),
        column(columns["doppler_hz"]),
        column(columns["doppler_rate_hz_per_s"]),
        column(table.sigma[:, SD_RANGE]),
        column(table.sigma[:, SD_DOPPLER]),
    )


def seeded_span(
    expected: SignalPrediction,
    channel: int,
    window: SearchWindow,
    settings: SampleReceiver,
    first: int,
    last: int,
) -> SearchSpan:
    """Return the supervisor's window of a satellite over some samples: its sigmas, its accumulation."""
    rate = settings.rate_hz
    mid_s = (0.5 * (first + last) - expected.sample) / rate
    turn = float(expected.doppler_rate_hz_per_s[channel])
    doppler = float(expected.doppler_hz[channel])
    delay_s = expected.delay_at(channel, first, rate) / C_MPS
    sigmas = settings.search.grid.sigmas
    local_chips = float(delay_s * GPS_CA_CHIP_HZ) - origin_chips(first, rate)
    half_chips = sigmas * float(window.sigma_delay_m.ravel()[channel]) / C_MPS * GPS_CA_CHIP_HZ
    return SearchSpan(
        doppler + turn * mid_s,
        sigmas * float(window.sigma_doppler_hz.ravel()[channel]),
        local_chips % 1023.0,
        max(half_chips, LEAST_WINDOW_CHIPS),
        turn,
        settings.look_s,
        settings.looks,
    )


def unseeded_span(settings: SampleReceiver) -> SearchSpan:
    """Return the span of a receiver without prior knowledge: all delays, all Dopplers."""
    return SearchSpan(0.0, settings.unseeded_doppler_hz, coherent_s=settings.look_s, looks=settings.looks)


def search_for(
    samples: SignalSamples,
    codes: Sequence[RangingCode],
    span: SearchSpan,
    pfa: float,
    first: int,
    expected_m: Sequence[float] | None = None,
) -> list[SearchOutcome]:
    """Return the searches of some codes over one span; the time each took is its share.

    ``expected_m`` are pseudoranges at the first sample, good to half a millisecond, by which the data bits are known.
    A detection is a cell beyond the threshold whose false-alarm probability, summed over all cells, is ``pfa``.
    """
    began = time.perf_counter()
    bits = None
    if expected_m is not None:
        origin = origin_chips(first, samples.sampling.rate_hz)
        bits = [delay_m / C_MPS * GPS_CA_CHIP_HZ - origin for delay_m in expected_m]
    acquired = acquire(samples, codes, span, L1_HZ, bits)
    took_s = (time.perf_counter() - began) / len(codes)
    last = first + len(samples.in_phase)
    searches = []
    for each in acquired:
        edge = float(threshold(pfa / each.cells, span.looks))
        searches.append(SearchOutcome(each.statistic > edge, edge, each, span, first, last, took_s))
    return searches


def acquire_recording(
    file: IqFile, start_s: float, look_s: float, looks: int, doppler_hz: float, pfa: float
) -> pd.DataFrame:
    """Return the search result for every GPS satellite in a recording: one row each, the strongest first.

    ``status`` is "found", "not_found", or "cross_correlation": beyond the threshold but more than 15 dB below the
    strongest signal, whose correlation with another code alone may be that high (65/1023 of the amplitude are 24 dB,
    and several strong signals and other Dopplers add).

    Raises
    ------
    InputError : the recording is shorter than that
    ConfigError : what is declared cannot be searched
    """
    require_not_negative("give the seconds after the beginning of the recording", start_s=start_s)
    rate, code_s = file.sampling.rate_hz, 1e-3
    first = round(start_s * rate)
    count = math.ceil((looks * look_s + code_s) * rate)
    span = SearchSpan(0.0, doppler_hz, coherent_s=look_s, looks=looks)
    if not 0.0 < pfa < 1.0:
        raise ConfigError(f"invalid probability pfa {pfa:g}", key="pfa", advice="give 0 < pfa < 1, as 1e-3")
    searches = search_for(file.read(first, count), [gps_ca(prn) for prn in GPS_ORBIT_PRNS], span, pfa, first)
    table = pd.DataFrame(
        {
            "sv": [f"G{prn:02d}" for prn in GPS_ORBIT_PRNS],
            "status": [FOUND if s.found else NOT_FOUND for s in searches],
            "cn0_dbhz": [s.acquired.cn0_dbhz for s in searches],
            "doppler_hz": [s.acquired.doppler_hz for s in searches],
            "delay_chips": [s.acquired.delay_chips for s in searches],
            "statistic": [s.acquired.statistic for s in searches],
            "threshold": [s.threshold for s in searches],
        }
    )
    weak = table["cn0_dbhz"] < table["cn0_dbhz"].max() - CROSS_CORRELATION_DB
    table.loc[weak & (table["status"] == FOUND), "status"] = CROSS_CORRELATION
    return table.sort_values("statistic", ascending=False, ignore_index=True)
