"""Faults of a receiver's observations, as functions to hand to ``observe``; times are receiver tags, ``[from, to)``.

A jump of the receiver's clock is a fault of the clock: ``oscillator.with_clock_jump``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from insgnss.errors import ConfigError
from insgnss.gnss.signals import wavelength_m
from insgnss.simulation.observations import SYSTEM, Fault, SignalObservations
from insgnss.tables import LLI_HALF_CYCLE, LLI_SLIP, Bool, Float64, Int8


def _where(
    observations: SignalObservations, sv: Iterable[str], from_s: float, to_s: float, signal: str | None = None
) -> Bool:
    """Return (m, n), true for these satellites within the window, on one signal or on all."""
    window = (observations.tag_s >= from_s) & (observations.tag_s < to_s)
    columns = np.isin(observations.sv_names, list(sv))
    if signal is not None:
        columns &= np.array(observations.signals) == signal
    return np.asarray(np.outer(window, columns))


def range_step(sv: str, size_m: float, from_s: float, to_s: float = np.inf) -> Fault:
    """Return the fault that adds ``size_m`` to the pseudorange of one satellite."""

    def fault(observations: SignalObservations) -> SignalObservations:
        added = size_m * _where(observations, [sv], from_s, to_s)
        return replace(observations, pseudorange_m=observations.pseudorange_m + added)

    return fault


def system_offset(system: str, size_m: float) -> Fault:
    """Return the fault that adds ``size_m`` to all pseudoranges of a system, whose clock the receiver sees apart."""

    def fault(observations: SignalObservations) -> SignalObservations:
        own = np.char.startswith(np.array(observations.sv_names), system)
        return replace(observations, pseudorange_m=observations.pseudorange_m + size_m * own)

    return fault


def range_ramp(sv: str, rate_mps: float, from_s: float, to_s: float = np.inf) -> Fault:
    """Return the fault that lets the pseudorange of one satellite run away; its Doppler stays right."""

    def fault(observations: SignalObservations) -> SignalObservations:
        elapsed = np.maximum(observations.tag_s - from_s, 0.0)[:, None]
        added = rate_mps * elapsed * _where(observations, [sv], from_s, to_s)
        return replace(observations, pseudorange_m=observations.pseudorange_m + added)

    return fault


def false_lock(
    sv: str,
    from_s: float,
    to_s: float,
    *,
    offset_m: float,
    growth_mps: float,
    rate_error_mps: float,
    cn0_dbhz: float,
) -> Fault:
    """Return the fault of a channel that tracks something else than its satellite and still reports it.

    The pseudorange is off by ``offset_m`` when it begins and by ``growth_mps`` more each second, the range rate by
    ``rate_error_mps``; the noise stays that of the channel. Whether the satellite can be seen does not matter.
    """

    def fault(observations: SignalObservations) -> SignalObservations:
        where = _where(observations, [sv], from_s, to_s)
        off = offset_m + growth_mps * (observations.tag_s - from_s)[:, None]
        return replace(
            observations,
            pseudorange_m=observations.pseudorange_m + off * where,
            range_rate_mps=observations.range_rate_mps + rate_error_mps * where,
            cn0_dbhz=np.where(where, cn0_dbhz, observations.cn0_dbhz),
            tracked=observations.tracked | where,
        )

    return fault


def outage(sv: Iterable[str] | None, from_s: float, to_s: float) -> Fault:
    """Return the fault that hides these satellites, or all of them when None."""

    def fault(observations: SignalObservations) -> SignalObservations:
        names = observations.sv_names if sv is None else sv
        return replace(
            observations, tracked=observations.tracked & ~_where(observations, names, from_s, to_s)
        )

    return fault


def carrier_false_lock(
    sv: str, offset_hz: float, from_s: float, to_s: float = np.inf, *, cn0_drop_db: float = 6.0
) -> Fault:
    """Return the fault of a carrier loop locked ``offset_hz`` beside its frequency, as at half the data rate.

    Doppler and carrier go wrong together, the code stays right, and the signal seems weaker.
    """

    def fault(observations: SignalObservations) -> SignalObservations:
        off = _where(observations, [sv], from_s, to_s)
        wavelength = np.array([wavelength_m(SYSTEM, code) for code in observations.signals])
        carrier = observations.carrier_cycles
        if carrier is not None:
            held_s = np.clip(observations.tag_s, from_s, to_s) - from_s
            # the carrier that was lost off the signal does not come back
            locked = np.outer(held_s, np.isin(observations.sv_names, [sv]))
            carrier = carrier - offset_hz * locked
        return replace(
            observations,
            range_rate_mps=observations.range_rate_mps - offset_hz * wavelength * off,
            cn0_dbhz=observations.cn0_dbhz - cn0_drop_db * off,
            carrier_cycles=carrier,
        )

    return fault


def reversed_range_rate() -> Fault:
    """Return the fault of a log whose Doppler has the wrong sign."""

    def fault(observations: SignalObservations) -> SignalObservations:
        return replace(observations, range_rate_mps=-observations.range_rate_mps)

    return fault


def _phases(observations: SignalObservations) -> tuple[Float64, Int8]:
    """Return carrier phases and indicators; an error where the receiver logs none."""
    if observations.carrier_cycles is None or observations.lli is None:
        raise ConfigError(
            "a fault of the carrier needs a receiver that logs it", advice="give Receiver a carrier_noise"
        )
    return observations.carrier_cycles, observations.lli


def cycle_slip(
    sv: Iterable[str], cycles: float, at_s: float, *, signal: str | None = None, indicated: bool = False
) -> Fault:
    """Return the fault that shifts the carrier of satellites by ``cycles`` from a tag on, as a loss of lock does.

    ``indicated`` lets the receiver notice: its indicator is set at the first epoch with the new ambiguity.
    """

    def fault(observations: SignalObservations) -> SignalObservations:
        carrier, lli = _phases(observations)
        slipped = _where(observations, sv, at_s, np.inf, signal)
        first = slipped & (np.cumsum(slipped, axis=0) == 1)
        marked = np.where(first & indicated, lli | LLI_SLIP, lli).astype(np.int8)
        return replace(observations, carrier_cycles=carrier + cycles * slipped, lli=marked)

    return fault


def half_cycle(sv: Iterable[str], from_s: float, to_s: float, *, flagged: bool = True) -> Fault:
    """Return the fault of a carrier that is half a cycle off within a window, as before its data bits are known."""

    def fault(observations: SignalObservations) -> SignalObservations:
        carrier, lli = _phases(observations)
        off = _where(observations, sv, from_s, to_s)
        marked = np.where(off & flagged, lli | LLI_HALF_CYCLE, lli).astype(np.int8)
        return replace(observations, carrier_cycles=carrier + 0.5 * off, lli=marked)

    return fault


def carrier_without_clock_step(at_s: float, size_m: float) -> Fault:
    """Return the fault of a receiver that steps its clock in tags and pseudoranges, but not in its carriers."""

    def fault(observations: SignalObservations) -> SignalObservations:
        carrier, _ = _phases(observations)
        wavelength = np.array([wavelength_m(SYSTEM, code) for code in observations.signals])
        stepped = (observations.tag_s >= at_s)[:, None]
        return replace(observations, carrier_cycles=carrier - stepped * size_m / wavelength)

    return fault


def carrier_alone(sv: Iterable[str], from_s: float, to_s: float) -> Fault:
    """Return the fault of a log that holds carriers without pseudorange and Doppler."""

    def fault(observations: SignalObservations) -> SignalObservations:
        _phases(observations)
        bare = _where(observations, sv, from_s, to_s)
        return replace(
            observations,
            pseudorange_m=np.where(bare, np.nan, observations.pseudorange_m),
            range_rate_mps=np.where(bare, np.nan, observations.range_rate_mps),
        )

    return fault
