"""Samples of GPS L1 C/A as an antenna receives them: from the true paths of a scenario to complex or real samples.

The truth of the signals is what ``observations`` says of them without noise, at the borders of milliseconds by the
receiver's clock: pseudorange for code and data, carrier phase for the carrier, C/N0 for the amplitude. Between them
delay and phase run straight on (neglects: a T^2 / 8, 6e-6 m for 5 g). Data bits are random, 50 a second, and change
where the satellite's clock says; the signal of a satellite that the scenario hides is absent.

    sky = signal_sky(scenario, 60.0, rng)
    for block in sample_blocks(sky, Sampling(4e6, is_complex=True), seed=1):
        block.in_phase, block.quadrature                # one second of noise of variance 1 and signals
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.kernels.jit import kernel
from insgnss.simulation.observations import (
    SIGNAL,
    SYSTEM,
    WAVELENGTH_M,
    NoiseTerms,
    SignalObservations,
    observe,
)
from insgnss.simulation.oscillator import ClockTruth, simulate_clock
from insgnss.simulation.simulated_log import Scenario
from insgnss.tables import Float64, Int8, Int64
from insgnss.tracking.admissible import require_number, seeded
from insgnss.tracking.codes import GPS_CA_CHIP_HZ, GPS_PRNS, RangingCode, gps_ca
from insgnss.tracking.sample_kernels import Steps, add_signal
from insgnss.tracking.signal import Sampling, SignalSamples

BORDER_S: Final = 1e-3
BLOCK_S: Final = 1.0
BIT_PERIODS: Final = 20  # of the code in a data bit; IS-GPS-200N, 3.3.2.2 and 20.3.2
_TAGS_AT_ONCE: Final = 5000  # of 30 satellites: 100 MB of geometry
_LEAST_MS: Final = 20  # a data bit
_GRID_NS: Final = 20_000_000  # on which the data bits stand, GPS time


@dataclass(frozen=True)
class SignalSky:
    """The signals of m satellites at the borders of milliseconds, n + 1 of them."""

    sv_names: tuple[str, ...]
    codes: tuple[RangingCode, ...]
    start_ns: int  # receiver time of the first sample
    pseudorange_m: Float64  # (n + 1, m)
    carrier_m: Float64  # (n + 1, m) grows with the distance
    range_rate_mps: Float64  # (n + 1, m)
    cn0_dbhz: Float64  # (n + 1, m) NaN where there is no signal
    bits: Int8  # (b, m) signs of the data, the first one of the bit that arrives first
    first_bit: Int64  # (m,) its number since the recording's beginning, negative
    clock: ClockTruth  # at the borders

    @property
    def duration_s(self) -> float:
        """Return the length of the recording."""
        return (len(self.pseudorange_m) - 1) * BORDER_S


def signal_sky(
    scenario: Scenario,
    duration_s: float,
    rng: np.random.Generator,
    *,
    cn0_change_db: float = 0.0,
) -> SignalSky:
    """Return the signals of a scenario's satellites above its horizon mask, with a newly drawn clock.

    Parameters
    ----------
    scenario : with its trajectory, sky, antennas, clock and faults; its receiver's noise and loops do not count
    duration_s : from the scenario's start on, whole milliseconds
    rng : of clock and data
    cn0_change_db : added to every C/N0 of the scenario

    Raises
    ------
    ConfigError : no whole data bit at the start, longer than the scenario, or no satellite with a C/A code
    """
    count = _checked_count(scenario, duration_s)
    start = scenario.clock
    clock = simulate_clock(
        scenario.oscillator,
        np.asarray(np.arange(count + 1) * BORDER_S, np.float64),
        rng,
        bias_m=start.bias_m,
        drift_mps=start.drift_mps,
    )
    seen = _observed(scenario, clock)
    columns = [
        c
        for c, (name, code) in enumerate(zip(seen.sv_names, seen.signals, strict=True))
        if code == SIGNAL and name[0] == SYSTEM and int(name[1:]) in GPS_PRNS and seen.tracked[:, c].any()
    ]
    if not columns:
        advice = "lower gnss.horizon_mask_deg, or give the sky GPS satellites"
        raise ConfigError("no satellite sends a C/A code to the antenna", key="sky", advice=advice)
    assert seen.carrier_cycles is not None
    cn0 = np.where(seen.tracked[:, columns], seen.cn0_dbhz[:, columns] + cn0_change_db, np.nan)
    pseudorange = seen.pseudorange_m[:, columns]
    first_bit = np.floor(-pseudorange[0] / C_MPS / (BIT_PERIODS * BORDER_S)).astype(np.int64) - 1
    bits = 1 - 2 * rng.integers(0, 2, (count // BIT_PERIODS + 12, len(columns)), np.int8)
    return SignalSky(
        tuple(seen.sv_names[c] for c in columns),
        tuple(gps_ca(int(seen.sv_names[c][1:])) for c in columns),
        scenario.start_ns,
        pseudorange,
        seen.carrier_cycles[:, columns] * WAVELENGTH_M,
        seen.range_rate_mps[:, columns],
        cn0,
        bits,
        first_bit,
        clock,
    )


def _checked_count(scenario: Scenario, duration_s: float) -> int:
    """Return the number of milliseconds."""
    count = round(duration_s / BORDER_S) if math.isfinite(require_number("duration_s", duration_s)) else 0
    if count < _LEAST_MS or duration_s > scenario.duration_s + 1e-9:
        advice = f"take from {_LEAST_MS} ms to {scenario.duration_s:g} s, the length of the scenario"
        raise ConfigError(f"a recording of {duration_s:g} s", key="duration_s", advice=advice)
    if scenario.start_ns % _GRID_NS:
        advice = "let the scenario start at a multiple of 20 ms of the GPS week"
        raise ConfigError("the recording starts inside a data bit", key="start_s", advice=advice)
    return count


def _observed(scenario: Scenario, clock: ClockTruth) -> SignalObservations:
    """Return what there is to be observed at the tags of a clock, without noise, loops and thresholds."""
    receiver = replace(
        scenario.receiver,
        signals=(SIGNAL,),
        carrier_noise=NoiseTerms(0.0),
        tracking=None,
    )
    eph = scenario.navigation.ephemerides
    parts = [
        observe(
            scenario.trajectory,
            eph,
            scenario.start_ns,
            ClockTruth(*(column[first : first + _TAGS_AT_ONCE] for column in vars(clock).values())),
            receiver,
            None,
            scenario.faults,
        )
        for first in range(0, len(clock.tag_s), _TAGS_AT_ONCE)
    ]

    def whole(name: str) -> Float64:
        return np.concatenate([getattr(part, name) for part in parts])

    return replace(
        parts[0],
        tag_s=clock.tag_s,
        pseudorange_m=whole("pseudorange_m"),
        range_rate_mps=whole("range_rate_mps"),
        cn0_dbhz=whole("cn0_dbhz"),
        tracked=whole("tracked") > 0,
        carrier_cycles=whole("carrier_cycles"),
        lli=None,
    )


@kernel
def add_sky(
    borders: Int64,
    amplitude: Float64,
    chips: Int8,
    signs: Int8,
    code: Float64,
    cycles: Float64,
    in_phase: Float64,
    quadrature: Float64,
) -> None:
    """Add all signals of a block to its samples, millisecond by millisecond.

    Parameters
    ----------
    borders : (k + 1,) number of the first sample of each millisecond in the block; the last one ends it
    amplitude : (k, m) 0 for no signal
    chips : (m, length) of the codes
    signs : (periods, m) of the data in each code period, the first one of period 0
    code, cycles : (k, m, 2) code phase [chips from period 0 on] and carrier phase [cycles] of the first sample of
        each millisecond, and from sample to sample
    in_phase, quadrature : (n,) added to; quadrature (0,) for real samples
    """
    for k in range(borders.size - 1):
        span = slice(borders[k], borders[k + 1])
        for c in range(chips.shape[0]):
            if amplitude[k, c] > 0.0:
                add_signal(
                    amplitude[k, c],
                    chips[c],
                    signs[:, c],
                    Steps(code[k, c, 0], code[k, c, 1], cycles[k, c, 0], cycles[k, c, 1]),
                    in_phase[span],
                    quadrature[span] if quadrature.size > 0 else quadrature,
                )


def sample_blocks(
    sky: SignalSky, sampling: Sampling, seed: int, *, noise: bool = True
) -> Iterator[SignalSamples]:
    """Yield the samples of a sky, second by second; the noise of each second has a seed of its own.

    Equation: y_k = sum A h(R t_k - delay) d cos(w_if t_k - 2 pi P_carrier / lambda) + n_k, and sin for the quadrature

    Parameters
    ----------
    sampling : complex samples, or real ones at an intermediate frequency
    seed : of the noise
    noise : variance 1 in each component; without it the signals alone, scaled as with it

    Raises
    ------
    ConfigError : the sampling folds a signal or kills a quadrature
    """
    doppler = np.abs(sky.range_rate_mps).max() / WAVELENGTH_M
    sampling.check(GPS_CA_CHIP_HZ, BORDER_S, float(doppler))
    count = round(sky.duration_s / BORDER_S)
    size = round(BLOCK_S / BORDER_S)
    chips = np.stack([code.chips for code in sky.codes])
    for number, first in enumerate(range(0, count, size)):
        rng = seeded(seed, number)
        yield _block(sky, sampling, first, min(first + size, count), chips, rng if noise else None)


def _block(
    sky: SignalSky,
    sampling: Sampling,
    first: int,
    last: int,
    chips: Int8,
    rng: np.random.Generator | None,
) -> SignalSamples:
    """Return the samples of the milliseconds ``first`` to ``last``."""
    rate = sampling.rate_hz
    border_s = np.arange(first, last + 1) * BORDER_S
    # the first sample of each millisecond: samples are at whole multiples of 1 / rate
    number = np.ceil(border_s * rate - 1e-6).astype(np.int64)
    n = int(number[-1] - number[0])
    in_phase = np.zeros(n) if rng is None else rng.standard_normal(n)
    quadrature = np.zeros(0)
    if sampling.is_complex:
        quadrature = np.zeros(n) if rng is None else rng.standard_normal(n)
    row = slice(first, last + 1)
    late_s = (number[:-1] / rate - border_s[:-1])[:, None]  # of the first sample after its border
    chip_slope = GPS_CA_CHIP_HZ * (1.0 - np.diff(sky.pseudorange_m[row], axis=0) / C_MPS / BORDER_S)
    # periods are counted from the first data bit of each satellite on
    origin = sky.first_bit * BIT_PERIODS * 1023.0
    chip = GPS_CA_CHIP_HZ * (border_s[:-1, None] - sky.pseudorange_m[row][:-1] / C_MPS) - origin
    cycle_slope = -np.diff(sky.carrier_m[row], axis=0) / WAVELENGTH_M / BORDER_S
    cycle = -sky.carrier_m[row][:-1] / WAVELENGTH_M + cycle_slope * late_s
    cycle_slope = cycle_slope + sampling.intermediate_hz
    cycle += (sampling.intermediate_hz * number[:-1] / rate)[:, None]
    code = np.stack([chip + chip_slope * late_s, chip_slope / rate], axis=-1)
    cycles = np.stack([cycle % 1.0, cycle_slope / rate], axis=-1)
    strength = sky.cn0_dbhz[row][:-1]
    gain = sampling.amplitude(0.0) * 10.0 ** (0.05 * np.nan_to_num(strength))
    amplitude = np.where(np.isfinite(strength), gain, 0.0)
    signs = np.repeat(sky.bits, BIT_PERIODS, axis=0)
    add_sky(number - number[0], amplitude, chips, signs, code, cycles, in_phase, quadrature)
    return SignalSamples(sampling, in_phase, quadrature)
