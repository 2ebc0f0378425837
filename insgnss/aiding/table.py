"""The aiding of a whole run, or of one instant of a live one: from the filter's trace to the table ``run.aiding``.

| column | what |
|--------|------|
| time_s | seconds of the GPS week, the time of use |
| sv | satellite |
| range_rate_mps, range_acceleration_mps2, range_jerk_mps3 | of the distance to the phase centre, no clocks |
| pseudorange_m | distance, clocks, inter-system offset, air; NaN where the offset is not known to the filter |
| doppler_hz, doppler_rate_hz_per_s | at the carrier, RINEX sign, satellite's clock in, receiver's as asked |
| code_delay_rate_s_per_s | the code's rate from the Doppler: the rate of pseudorange / c |
| sd_* | one sigma of each, of the code delay rate that of the Doppler in s/s |
| age_s | time of use less the inertial sample that the value rests on |

A row takes 85 bytes (12 satellites at 100 Hz: 350 MiB an hour): doubles where a receiver's phase would feel less, four
bytes where 1e-7 of the value does not matter. The parts of the sigmas change as seldom as they do and are in a table
of its own, ``run.aiding_budget``, one row for each satellite whenever sigmas are recomputed:

| column | what |
|--------|------|
| time_s, sv | time of use from which the row holds, satellite |
| sd_rate_*_mps, cross_rate_m2ps2 | parts of the Doppler's sigma in m/s (``uncertainty.PARTS``), what correlation adds |
| sd_acceleration_*_mps2, cross_acceleration_m2ps4 | the same of the Doppler rate in m/s^2 |

At the time of an epoch the aiding is from before its update: which a receiver has at that instant. Sigma are those of
the last time at which a covariance was left behind (``AidingConfig.sigma_interval_s``), those of range rate and Doppler
carried on from there by the noise of the accelerometers and the walk of the receiver's clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.aiding.antenna_motion import VehicleTrace, turn_about_axis
from insgnss.aiding.columns import Times, fill_columns, new_columns
from insgnss.aiding.observables import (
    LANES,
    N_LANE_ROWS,
    Spans,
    Values,
    expand_satellite,
    fill_values,
    towards,
)
from insgnss.aiding.satellite_arcs import PIECE_NS, Arcs, SatelliteArcs, elevations
from insgnss.aiding.trace import Covariances, Trace, TraceSamples
from insgnss.aiding.uncertainty import (
    ACCELERATION_PARTS,
    N_PARTS,
    N_SIGMA,
    PARTS,
    RATE_PARTS,
    SD_RANGE,
    UncertaintyTerms,
    fill_sigma,
)
from insgnss.config.aiding import AidingConfig
from insgnss.constants import NS_PER_S, NS_PER_WEEK, WGS84_E2, WGS84_OMEGA_RADPS
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.range_model import AIR_DTYPE, AirModel, evaluate_atmosphere, slant_delay
from insgnss.gnss.signals import ionosphere_factor, signal_of, wavelength_m
from insgnss.gnss.troposphere import STANDARD_WEATHER, Weather
from insgnss.gpstime import ns_to_week_seconds
from insgnss.inertial.clock_model import ClockModel
from insgnss.inertial.sensor_model import SensorModel
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int16, Int64

COLUMNS: Final = (
    *("time_s", "sv", "range_rate_mps", "range_acceleration_mps2", "range_jerk_mps3"),
    *("doppler_hz", "doppler_rate_hz_per_s", "pseudorange_m", "code_delay_rate_s_per_s"),
    *("sd_range_rate_mps", "sd_range_acceleration_mps2", "sd_range_jerk_mps3"),
    *("sd_doppler_hz", "sd_doppler_rate_hz_per_s", "sd_pseudorange_m", "sd_code_delay_rate_s_per_s", "age_s"),
)


@dataclass(frozen=True)
class AidingSetup:
    """Everything that fixes the aiding before the first sample."""

    config: AidingConfig
    sensor: SensorModel
    clock: ClockModel
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock_groups: tuple[str, ...] = ("G",)  # of the filter, see ``gnss.clock_groups``
    channels: Mapping[str, int] | None = None  # of the GLONASS satellites
    klobuchar: Float64 | None = None  # (8,); None: no ionosphere
    troposphere: bool = True
    weather: Weather = STANDARD_WEATHER

    def doubts(self) -> UncertaintyTerms:
        """Return the numbers that the sigma needs besides the covariance."""
        use = self.config
        return UncertaintyTerms(
            gyro_density=self.sensor.gyro_density,
            accel_density=self.sensor.accel_density,
            gyro_scale=self.sensor.gyro_scale,
            accel_scale=self.sensor.accel_scale,
            drift_density=self.clock.drift_density,
            receiver_clock=float(use.receiver_clock),
            clock_averaging_s=use.clock_averaging_s,
            latency_s=use.latency_s,
            jerk_sigma=use.jerk_sigma_mps3,
            satellite_range=use.satellite_range_sigma_m,
            satellite_rate=use.satellite_rate_sigma_mps,
            satellite_acceleration=use.satellite_acceleration_sigma_mps2,
        )

    @property
    def signals(self) -> dict[str, str]:
        """RINEX code of each constellation's carrier."""
        return {str(letter): code for letter, code in self.config.signals.items()}

    def wavelengths(self, sv_names: tuple[str, ...]) -> Float64:
        """Return the carrier's wavelength of each satellite [m], NaN for GLONASS without a channel."""
        channels = self.channels or {}
        signals = self.signals
        return np.array([wavelength_m(n[0], signals[n[0]], channels.get(n)) for n in sv_names], np.float64)

    def groups(self, sv_names: tuple[str, ...]) -> Int64:
        """Return the clock group of each satellite's signal, -1 where the filter estimates none."""
        return np.array([self._group(name[0]) for name in sv_names], np.int64)

    def _group(self, letter: str) -> int:
        signal = signal_of(letter, self.signals[letter])
        homes = (letter, "G") if letter == "J" else (letter,)
        for home in homes:
            for name in (f"{home}:{'' if signal is None else signal.band}", home):
                if name in self.clock_groups:
                    return self.clock_groups.index(name)
        return -1

    def air(self, sv_names: tuple[str, ...]) -> AirModel:
        """Return the delays' model for these satellites."""
        channels, signals = self.channels or {}, self.signals
        factor = [ionosphere_factor(n[0], signals[n[0]], channels.get(n)) for n in sv_names]
        on = self.klobuchar is not None
        return AirModel(
            klobuchar=np.zeros(8) if self.klobuchar is None else np.ascontiguousarray(self.klobuchar),
            ionosphere=np.nan_to_num(np.array(factor, np.float64)) if on else np.zeros(len(sv_names)),
            troposphere=float(self.troposphere),
            weather=self.weather,
        )


@dataclass(frozen=True)
class AidingTable:
    """Aiding of some satellites at some times; rows are in the order of time, then of the span's satellites."""

    t_ns: Int64  # (n,) of the inertial samples behind the rows
    sv_names: tuple[str, ...]
    wavelength_m: Float64  # (s,)
    spans: Spans
    values: Values  # (rows,)
    sigma: npt.NDArray[np.float32]  # (q, N_SIGMA) of each span's satellites
    latency_s: float
    receiver_drift_mps: Float64  # (n,) zero where the receiver's clock is out
    since_s: Float64  # (n,) from the time at which the span's sigma were found
    doubts: UncertaintyTerms

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.values.range_rate)

    def _entries(self) -> Int64:
        """Return for each row the entry of its span and satellite."""
        count = np.repeat(np.diff(self.spans.first_satellite), np.diff(self.spans.first_time))  # of each time
        first_row = np.cumsum(count) - count
        first = np.repeat(self.spans.first_satellite[:-1], np.diff(self.spans.first_time))
        return np.repeat(first - first_row, count) + np.arange(self.n_rows)

    def at_last_time(self) -> AidingTable:
        """Return the rows of the last time alone."""
        count = int(self.spans.first_satellite[-1] - self.spans.first_satellite[-2])
        v = self.values
        own, row = slice(-count, None) if count else slice(0, 0), slice(self.n_rows - count, None)
        spans = Spans(
            np.array([0, 1]),
            np.array([0, count]),
            self.spans.satellite[own],
            self.spans.delay_m[own],
            self.spans.drift_mps[own],
        )
        return replace(
            self,
            t_ns=self.t_ns[-1:],
            spans=spans,
            values=Values(v.range_rate[row], v.pseudorange[row], v.acceleration[row], v.jerk[row]),
            sigma=self.sigma[own],
            receiver_drift_mps=self.receiver_drift_mps[-1:],
            since_s=self.since_s[-1:],
        )

    def satellite(self) -> Int16:
        """Return the satellite of each row, its number in ``sv_names``."""
        return np.asarray(self.spans.satellite[self._entries()], np.int16)

    def columns(self, week: int, *, parts: bool = False) -> dict[str, npt.NDArray[Any]]:
        """Return the columns of the table, at the time of use; ``sv`` as number in ``sv_names``.

        Parameters
        ----------
        week : GPS week that the seconds count from
        parts : the sigma's parts too
        """
        v, made = self.values, new_columns(self.n_rows)
        if self.latency_s == 0.0:  # the same numbers: no room of their own
            made = made._replace(range_rate_mps=v.range_rate, pseudorange_m=v.pseudorange)
        per_cycle = 1.0 / self.wavelength_m
        times = Times(self._used_s(self.t_ns, week), self.since_s, self.receiver_drift_mps)
        fill_columns(self.spans, v, self.sigma, times, per_cycle, self.doubts, made)
        table: dict[str, npt.NDArray[Any]] = made._asdict()
        table |= {"range_acceleration_mps2": v.acceleration, "range_jerk_mps3": v.jerk}
        table["age_s"] = np.full(self.n_rows, self.latency_s, np.float32)
        table = {name: table[name] for name in COLUMNS}
        if parts:
            entries = self._entries()
            table |= {name: column[entries] for name, column in self.parts().items()}
        return table

    def _used_s(self, t_ns: Int64, week: int) -> Float64:
        """Return the times of use of inertial samples [s of the week]."""
        return ns_to_week_seconds(t_ns + round(self.latency_s * NS_PER_S), week)

    def parts(self) -> dict[str, npt.NDArray[np.float32]]:
        """Return the parts of the sigmas of each span and satellite, as columns."""
        by_column = np.ascontiguousarray(self.sigma.T)
        rate = {f"sd_rate_{name}_mps": by_column[RATE_PARTS + i] for i, name in enumerate(PARTS)}
        rate["cross_rate_m2ps2"] = by_column[RATE_PARTS + N_PARTS]
        of_acceleration = by_column[ACCELERATION_PARTS:]
        acceleration = {f"sd_acceleration_{name}_mps2": of_acceleration[i] for i, name in enumerate(PARTS)}
        return rate | acceleration | {"cross_acceleration_m2ps4": of_acceleration[N_PARTS]}

    def budget(self, week: int) -> dict[str, npt.NDArray[Any]]:
        """Return the parts with the time of use from which they hold, and the satellite: ``run.aiding_budget``."""
        count = np.diff(self.spans.first_satellite)
        begin_s = self._used_s(self.t_ns[self.spans.first_time[:-1]], week)
        return {
            "time_s": np.repeat(begin_s, count),
            "sv": self.spans.satellite.astype(np.int16),
            **self.parts(),
        }


def compute_aiding(
    setup: AidingSetup, satellites: SatelliteArcs, trace: Trace, imu: TraceSamples, covariances: Covariances
) -> AidingTable:
    """Return the aiding of every satellite above the horizon at all times of a trace.

    Parameters
    ----------
    satellites : pieces that cover the trace
    trace : the filter's states at the output times
    imu : the inertial samples that ``trace.sample`` counts
    covariances : at least one not later than the trace's first time, else the first rows have no sigma
    """
    spans, values, sigma = aiding_arrays(setup, satellites, trace, imu, covariances)
    names = satellites.sv_names
    begin_ns = np.repeat(trace.t_ns[spans.first_time[:-1]], np.diff(spans.first_time))
    return AidingTable(
        t_ns=trace.t_ns,
        sv_names=names,
        wavelength_m=setup.wavelengths(names),
        spans=spans,
        values=values,
        sigma=sigma.astype(np.float32),
        latency_s=setup.config.latency_s,
        receiver_drift_mps=float(setup.config.receiver_clock) * trace.clock[:, 1],
        since_s=np.asarray((trace.t_ns - begin_ns) * 1e-9, np.float64),
        doubts=setup.doubts(),
    )


def aiding_arrays(
    setup: AidingSetup, satellites: SatelliteArcs, trace: Trace, imu: TraceSamples, covariances: Covariances
) -> tuple[Spans, Values, Float64]:
    """Return the parts of the table: spans, values, and the sigma (q, N_SIGMA) to their last digit."""
    names, arcs = satellites.sv_names, satellites.arcs
    lever_b = np.array(setup.lever_arm_m, np.float64)
    groups = setup.groups(names)
    spans = visible_spans(setup.config, satellites, trace, covariances.t_ns, lever_b)
    at = np.repeat(spans.first_time[:-1], np.diff(spans.first_satellite))
    offset = np.column_stack([np.full(len(trace.t_ns), np.nan), np.zeros(len(trace.t_ns)), trace.offset])
    spans.delay_m[:] = offset[at, groups[spans.satellite] + 1]
    fill_delays(trace, arcs, spans, lever_b, setup.air(names))
    rows = int(np.sum(np.diff(spans.first_time) * np.diff(spans.first_satellite)))
    doubles, singles = np.empty((2, rows)), np.empty((2, rows), np.float32)
    values = Values(doubles[0], doubles[1], singles[0], singles[1])
    doubts, vehicle = setup.doubts(), VehicleTrace(trace, imu, lever_b, setup.config.slope_samples)
    fill_values(vehicle, arcs, spans, doubts.receiver_clock, values)
    sigma = np.full((len(spans.satellite), N_SIGMA), np.nan)
    first_ns = trace.t_ns[spans.first_time[:-1]]
    newest = np.searchsorted(covariances.t_ns, first_ns, side="right").astype(np.int64) - 1
    fill_sigma(vehicle, covariances, newest, arcs, spans, groups, doubts, sigma)
    sigma[groups[spans.satellite] < 0, SD_RANGE] = np.nan
    return spans, values, sigma


def visible_spans(
    config: AidingConfig, satellites: SatelliteArcs, trace: Trace, covariance_ns: Int64, lever_b: Float64
) -> Spans:
    """Return the spans of a trace and the satellites above the horizon at the first time of each.

    A span begins with each covariance, with each tick of the settings' interval, counted in GPS time so that a live run
    parts them as a replay does, and at a piece's border.
    """
    if len(trace.t_ns) == 0:
        nothing = np.zeros(0, np.int64)
        return Spans(np.zeros(1, np.int64), np.zeros(1, np.int64), nothing, np.zeros(0), np.zeros(0))
    tick = trace.t_ns // max(round(config.sigma_interval_s * NS_PER_S), 1)
    piece = trace.t_ns // PIECE_NS
    newest = np.searchsorted(covariance_ns, trace.t_ns, side="right")
    new = [np.diff(which, prepend=-1) != 0 for which in (tick, piece, newest)]
    begins = np.flatnonzero(np.logical_or.reduce(new))
    r_e = trace.r_e[begins] + trace.C_eb[begins] @ lever_b
    # the ellipsoid's vertical where it is cut by the position vector: within 1e-5 rad up to 20 km
    up = r_e / np.array([1.0, 1.0, 1.0 - WGS84_E2])
    up /= np.linalg.norm(up, axis=1)[:, None]
    sine = elevations(satellites.arcs, trace.t_ns[begins], r_e, up)
    seen = sine >= np.sin(np.radians(config.horizon_deg))  # False for NaN
    crowded = np.flatnonzero(seen.sum(axis=1) > LANES)
    if len(crowded):  # more than one receiver tracks: the highest stay
        lowest = -np.sort(-np.where(seen[crowded], sine[crowded], -2.0), axis=1)[:, LANES - 1]
        seen[crowded] &= sine[crowded] >= lowest[:, None]
    satellite = np.nonzero(seen)[1].astype(np.int64)
    first_satellite = np.concatenate([[0], np.cumsum(seen.sum(axis=1))]).astype(np.int64)
    first_time = np.append(begins, len(trace.t_ns)).astype(np.int64)
    n = len(satellite)
    return Spans(first_time, first_satellite, satellite, np.zeros(n), np.zeros(n))


@kernel
def fill_delays(trace: Trace, arcs: Arcs, spans: Spans, lever_b: Float64, air_model: AirModel) -> None:
    """Add the air's delay [m] of each satellite to ``spans.delay_m``, at the span's first time, at the sigma's rate.

    Held over a span: the troposphere of a satellite at 5 deg changes by up to 0.03 m/s, at 30 deg by 1 mm/s.
    """
    air = np.zeros(1, AIR_DTYPE)
    motion, line, u_n, C_ne = np.zeros((4, 3)), np.zeros((2, 3)), np.zeros(3), np.zeros((3, 3))
    r_a, e = np.zeros(3), np.zeros(N_LANE_ROWS * LANES)
    for span in range(len(spans.first_time) - 1):
        i = spans.first_time[span]
        C = trace.C_eb[i]
        for k in range(3):
            r_a[k] = trace.r_e[i, k] + C[k, 0] * lever_b[0] + C[k, 1] * lever_b[1] + C[k, 2] * lever_b[2]
            motion[0, k] = r_a[k]
        lat, lon, h = ecef_to_geodetic(r_a)
        ecef_to_ned_matrix(lat, lon, C_ne)
        week_s = (trace.t_ns[i] % NS_PER_WEEK) / NS_PER_S
        evaluate_atmosphere(air[0], lat, lon, h, week_s, air_model.troposphere, air_model.weather)
        since_ns = trace.t_ns[i] - arcs.start_ns
        p = since_ns // PIECE_NS
        since_s = (since_ns - p * PIECE_NS) / NS_PER_S
        turn_about_axis(motion, 0, 1, WGS84_OMEGA_RADPS * since_s)
        for j in range(spans.first_satellite[span], spans.first_satellite[span + 1]):
            satellite = spans.satellite[j]
            expand_satellite(arcs.pieces[satellite, p], since_s, motion, e, 0)
            towards(e, 0, motion, line)
            turn_about_axis(line, 0, 1, -WGS84_OMEGA_RADPS * since_s)
            for k in range(3):
                u_n[k] = C_ne[k, 0] * line[0, 0] + C_ne[k, 1] * line[0, 1] + C_ne[k, 2] * line[0, 2]
            spans.delay_m[j] += slant_delay(air[0], air_model.klobuchar, u_n, air_model.ionosphere[satellite])
