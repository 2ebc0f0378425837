"""Checks of a receiver study's options: each error names the key, the reason and the valid values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.interference.linear_threshold import LOWEST_CN0_DBHZ
from insgnss.simulation.closed_loop_sky import LONGEST_LATENCY_S
from insgnss.studies.receiver.estimated_cn0 import ESTIMATORS
from insgnss.studies.receiver.imu import require_gaps
from insgnss.studies.receiver.options import AVERAGED_S, LONGEST_WAIT_S, ReceiverOptions
from insgnss.studies.receiver.phase_return import SURE_SIGMAS
from insgnss.studies.receiver.runs import Setting
from insgnss.studies.receiver.variants import VARIANTS, Variant, variant_of
from insgnss.studies.receiver.workspace import INTERVAL_MESSAGE, TWO_STAGE
from insgnss.tables import Float64
from insgnss.tracking.admissible import (
    require_known,
    require_not_negative,
    require_number,
    require_positive,
    require_truth_value,
    require_whole,
    require_within,
)
from insgnss.tracking.discriminator_outputs import PHASE_KINDS
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.vector_loop import LEAST_DBHZ, MOST_DBHZ, ChannelConstants

_MAX_INTEGRATIONS: Final = 2_000_000
_CARRIER_HZ: Final = (1e8, 1e11)  # of satellite navigation: 1.1 to 5 GHz, and room around them
_CHIP_HZ: Final = (1e4, 1e9)
_ORBIT_M: Final = 1e9  # beyond the Moon no satellite navigates
_MOTION: Final = (1e4, 1e5)  # a thousand g [m/s^2]; a day [s]
_SHORTEST_MOTION: Final = 0.1  # of an integration: a shorter correlation time is lost in rounding
_BEST_CN0_DBHZ: Final = 60.0


class Integrations(NamedTuple):
    """Times of a study, in integrations."""

    interval: int  # between two updates of a second stage
    fall: int  # of C/N0
    average: int  # from which on errors are averaged
    total: int


def check_options(o: ReceiverOptions) -> None:
    """Refuse invalid options: times, directions or choices.

    Raises
    ------
    ConfigError : the first thing that makes no sense
    """
    if not isinstance(o, ReceiverOptions):
        raise ConfigError(f"{o!r} is not a set of options", key="options", advice="give ReceiverOptions(...)")
    require_truth_value(masking=o.masking, estimates_cn0=o.estimates_cn0)
    require_known(o.cn0_estimator, ESTIMATORS, "cn0_estimator", "estimator of C/N0")
    values: Any
    for key, values in (("azimuth_deg", o.azimuth_deg), ("elevation_deg", o.elevation_deg)):
        if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
            raise ConfigError(
                f"{values!r} is not a list of angles", key=key, advice="give degrees, as (20, 65)"
            )
        for value in values:
            require_within(-360.0, 360.0, "give degrees", **{key: value})
    require_not_negative(settle_s=o.settle_s)
    if o.average_s is not None:
        require_within(o.settle_s, math.inf, "average from settle_s on", average_s=o.average_s)
    if o.duration_s is not None:
        require_positive(duration_s=o.duration_s)


def with_duration(o: ReceiverOptions, longest_s: float, *, whole: bool) -> ReceiverOptions:
    """Return options with a duration: that which is asked for, or as long as errors may take to settle.

    Parameters
    ----------
    whole : a study whose duration is not given lasts as long as the motion

    Raises
    ------
    ConfigError : the motion is too short for it
    """
    wanted_s = o.duration_s
    if wanted_s is None:
        average_s = o.settle_s + LONGEST_WAIT_S if o.average_s is None else o.average_s
        wanted_s = average_s + AVERAGED_S
        if max(o.settle_s, o.average_s or 0.0) < longest_s:
            wanted_s = longest_s if whole else min(wanted_s, longest_s)
    if wanted_s > longest_s:
        raise ConfigError(
            f"the motion lasts {longest_s:g} s from the study's begin on, the study {wanted_s:g} s",
            key="duration_s"
            if o.duration_s is not None
            else "settle_s"
            if o.average_s is None
            else "average_s",
            advice="give less, or a longer scenario",
        )
    return replace(o, duration_s=wanted_s)


def integrations(o: ReceiverOptions) -> Integrations:
    """Return the times of a study; its duration is given.

    Errors are averaged from ``average_s`` on; where it is not given, from the fall of C/N0 on.

    Raises
    ------
    ConfigError : numbers that make no sense, or times that do not fit each other
    """
    assert o.duration_s is not None
    require_positive(duration_s=o.duration_s, step_s=o.step_s, interval_s=o.interval_s)
    _check_signal(o)
    require_not_negative(settle_s=o.settle_s, divergence_density=o.divergence_density)
    require_gaps(o.imu_gaps_s, o.duration_s, o.step_s)
    require_positive(unknown_mps2=o.unknown_mps2, unknown_s=o.unknown_s)
    require_within(0.0, _MOTION[0], "a thousand g at most", unknown_mps2=o.unknown_mps2)
    shortest_s = _SHORTEST_MOTION * o.step_s
    require_within(shortest_s, _MOTION[1], "a tenth of step_s to a day", unknown_s=o.unknown_s)
    require_within(0.0, LONGEST_LATENCY_S, "a tenth of a second at most", latency_s=o.latency_s)
    if o.imu_rate_hz is not None:
        require_within(10.0, 10_000.0, "samples per second", imu_rate_hz=o.imu_rate_hz)
    if o.step_s > o.symbol_s * (1.0 + 1e-9):
        raise ConfigError(
            f"an integration of {o.step_s:g} s is longer than a symbol of {o.symbol_s:g} s",
            key="step_s",
            advice="integrate for a symbol at most, or track a pilot: symbol_s = inf",
        )
    require_known(o.phase_kind, PHASE_KINDS, "phase_kind", "phase discriminator")
    if math.isfinite(o.symbol_s) and PhaseDiscriminator(o.phase_kind).aperture_rad > math.pi:
        raise ConfigError(
            f"the discriminator '{o.phase_kind}' takes every change of a symbol's sign for half a cycle",
            key="phase_kind",
            advice="give iq, sign or atan, or track a pilot: symbol_s = inf",
        )
    require_within(0.0, o.duration_s, "an interval is a part of the study", interval_s=o.interval_s)
    interval = round(o.interval_s / o.step_s)
    if interval < 2 or not _is_whole(o.interval_s, o.step_s):
        raise ConfigError(
            f"an interval of {o.interval_s:g} s is not a whole number of integrations of {o.step_s:g} s",
            key="interval_s",
            advice=f"give a multiple, as {max(interval, 2) * o.step_s:g}",
        )
    count, settle = round(o.duration_s / o.step_s), round(o.settle_s / o.step_s)
    if not settle < count <= _MAX_INTEGRATIONS:
        raise ConfigError(
            f"{count} integrations, of which {settle} settle",
            key="duration_s",
            advice=f"fly longer than settle_s, and for {_MAX_INTEGRATIONS} integrations at most",
        )
    if o.average_s is None:
        return Integrations(interval, settle, settle, count)
    require_within(
        o.settle_s,
        o.duration_s - o.step_s,
        "give a second between the fall of C/N0 (settle_s) and the end (duration_s)",
        average_s=o.average_s,
    )
    return Integrations(interval, settle, round(o.average_s / o.step_s), count)


def _check_signal(o: ReceiverOptions) -> None:
    """Refuse a signal, an orbit or an oscillator's steps that no receiver has.

    Raises
    ------
    ConfigError : the first thing that makes no sense
    """
    if not require_number("symbol_s", o.symbol_s) > 0.0:
        raise ConfigError(
            f"a symbol of {o.symbol_s:g} s", key="symbol_s", advice="give seconds, or inf for a pilot"
        )
    require_within(*_CARRIER_HZ, "give hertz, as 1575.42e6", carrier_hz=o.carrier_hz)
    require_within(*_CHIP_HZ, "give chips per second, as 1.023e6", chip_hz=o.chip_hz)
    require_positive(orbit_radius_m=o.orbit_radius_m)
    require_within(0.0, _ORBIT_M, "give metres, as 26.56e6", orbit_radius_m=o.orbit_radius_m)
    require_not_negative(replica_step_m=o.replica_step_m, replica_step_mps=o.replica_step_mps)
    require_within(0.0, C_MPS / o.chip_hz, "a chip at most", replica_step_m=o.replica_step_m)
    # a step of frequency of more than a cycle in an integration
    fastest = C_MPS / o.carrier_hz / o.step_s
    require_within(0.0, fastest, "a cycle in an integration at most", replica_step_mps=o.replica_step_mps)
    levels = f"give {LEAST_DBHZ:g} to {MOST_DBHZ:g} dBHz"
    if o.told_cn0_dbhz is not None:
        require_within(LEAST_DBHZ, MOST_DBHZ, levels, told_cn0_dbhz=o.told_cn0_dbhz)
        if o.estimates_cn0:
            raise ConfigError(
                f"the receiver takes {o.told_cn0_dbhz:g} dBHz for true, and estimates its C/N0 too",
                key="told_cn0_dbhz",
                advice="give told_cn0_dbhz, or estimates_cn0 = true",
            )
    if o.least_cn0_dbhz is not None:
        require_within(LEAST_DBHZ, MOST_DBHZ, levels, least_cn0_dbhz=o.least_cn0_dbhz)


def checked_call(
    cn0: Sequence[float], numbers: Mapping[str, int], wanted: Mapping[str, Variant], *, with_ins: bool
) -> list[float]:
    """Return the levels of C/N0, the highest first; ``numbers`` are runs and threads.

    Raises
    ------
    ConfigError : the first thing that makes no sense
    """
    try:
        given = np.atleast_1d(np.asarray(cn0))
        if given.dtype == np.bool_:
            raise TypeError
        levels = sorted({float(x) for x in given}, reverse=True)
    except (TypeError, ValueError):
        raise ConfigError(
            f"{cn0!r} is not a list of C/N0", key="cn0", advice="give dBHz, as [45, 35]"
        ) from None
    if not levels or not all(LOWEST_CN0_DBHZ <= x <= _BEST_CN0_DBHZ for x in levels):
        raise ConfigError(
            f"C/N0 of {', '.join(f'{x:g}' for x in levels) or 'nothing'} dBHz",
            key="cn0",
            advice=f"give {LOWEST_CN0_DBHZ:g} to {_BEST_CN0_DBHZ:g} dBHz: below it no receiver tracks",
        )
    if not wanted:
        raise ConfigError("no receiver is named", key="variants", advice=f"known: {', '.join(VARIANTS)}")
    require_whole(1, "40 runs determine a share within 8 %", **numbers)
    aided = [name for name, variant in wanted.items() if variant.needs_ins]
    if aided and not with_ins:
        raise ConfigError(
            f"'{aided[0]}' needs an inertial system for aiding, and none is given",
            key="variants",
            advice='without INS there are "scalar", "optimal" and "one_stage"',
        )
    return levels


def wanted_variants(variants: Sequence[str | Variant]) -> dict[str, Variant]:
    """Return receivers by their names, those of one's own by their words.

    Raises
    ------
    ConfigError : an unknown name, or one name for two receivers
    """
    asked: Sequence[Any] = (variants,) if isinstance(variants, str | Variant) else variants
    if not isinstance(asked, Sequence | np.ndarray):
        advice = f"give a list of {', '.join(VARIANTS)}"
        raise ConfigError(f"{asked!r} is not a list of receivers", key="variants", advice=advice)
    named: dict[str, Variant] = {}
    for each in asked:
        variant = variant_of(each)
        name = each if isinstance(each, str) else variant.words
        if named.setdefault(name, variant) != variant:
            raise ConfigError(
                f"two different receivers are called '{name}'",
                key="variants",
                advice="give each its own words, as replace(RECEIVERS[...], words=...)",
            )
    return named


def require_imu(imu: Any) -> None:
    """Refuse anything but an inertial system.

    Raises
    ------
    ConfigError : neither a name, nor a grade, nor None
    """
    if not (imu is None or isinstance(imu, str | ImuGrade)):
        raise ConfigError(
            f"{imu!r} is not an inertial system",
            key="imu",
            advice="give a grade by name, an ImuGrade, or None",
        )


def require_slow_oscillator(drift_density: float, channels: ChannelConstants) -> None:
    """Refuse an oscillator that the loops of ``step_s`` cannot follow: their B T is too large.

    Equation: 4 sqrt(S / 2 t) t < half the distance of the stable points; t an integration, or a half of it where
              frequency is tracked (a cycle of which data leave one half)

    Raises
    ------
    ConfigError : the phase is open from one integration to the next
    """
    t = channels.step_s if channels.coherent else 0.5 * channels.step_s
    kind = PHASE_KINDS[channels.kinds[0]] if channels.coherent else "iq"
    turned = math.sqrt(0.5 * drift_density * t) * t
    limit = 0.5 * PhaseDiscriminator(kind).aperture_rad / SURE_SIGMAS
    if not turned < limit:
        most = 2.0 * limit**2 / t**3
        raise ConfigError(
            f"an oscillator of {drift_density:g} rad^2/s^3 turns the phase by {turned:.2g} rad (1 sigma) within "
            f"{t:g} s: B T is too large",
            key="step_s",
            advice=f"integrate for a shorter time, or take an oscillator below {most:.2g} rad^2/s^3",
        )


def unused_options(
    o: ReceiverOptions, wanted: Mapping[str, Variant], tracking: str, *, with_ins: bool
) -> dict[str, ConfigError]:
    """Return by its key the error of each option that is set and that no receiver uses.

    These are settings of an inertial system where no receiver has one, a phase discriminator where no phase is tracked,
    a spacing or a divergence of phase and code where no code is, an interval where no receiver has a second stage, and
    an estimator of C/N0 where it is known.

    Raises
    ------
    ConfigError : ``step_s`` is not positive
    """
    usual, receivers = ReceiverOptions(), wanted.values()
    coherent, with_code = tracking == "coherent", any(variant.with_code for variant in receivers)
    with_ins = with_ins and any(variant.has_filter for variant in receivers)
    no_ins = (with_ins, "the receivers have no inertial system", "give an inertial system")
    add_code = 'add "one_stage_code" to the receivers'
    require_positive(step_s=o.step_s)
    # an interval must be a whole number of integrations, used or not
    is_usual_whole = _is_whole(usual.interval_s, o.step_s)
    needs_interval = any(variant.has_second_stage for variant in receivers) or not is_usual_whole
    needed = {
        **dict.fromkeys(("latency_s", "imu_gaps_s", "imu_rate_hz"), no_ins),
        "interval_s": (needs_interval, "no receiver has a second stage", 'add "optimal" to the receivers'),
        "phase_kind": (coherent, "no receiver tracks the phase", 'give tracking = "coherent"'),
        "spacing_chips": (with_code or not coherent, "no receiver uses the code", add_code),
        "divergence_density": (with_code, "no receiver compares phase with code", add_code),
        "cn0_estimator": (o.estimates_cn0, "the receivers know C/N0", "give estimates_cn0 = true"),
    }
    return {
        key: ConfigError(lacking, key=key, advice=f"{cure}, or leave out {key}")
        for key, (is_used, lacking, cure) in needed.items()
        if not is_used and _is_set(getattr(o, key), getattr(usual, key))
    }


def _is_whole(interval_s: float, step_s: float) -> bool:
    """Return whether an interval is a whole number of integrations."""
    return abs(math.remainder(interval_s, step_s)) <= 1e-9


def _is_set(value: Any, usual: Any) -> bool:
    return len(value) > 0 if isinstance(usual, tuple) else value != usual


def require_answers(setting: Setting, wanted: Mapping[str, Variant], cn0: Mapping[float, Float64]) -> None:
    """Refuse receivers that cannot give a result in this setting.

    Raises
    ------
    ConfigError : least squares without a geometry, channels that follow nothing, intervals that do not show an
        acceleration, or a C/N0 that no channel reaches
    """
    for name, variant in wanted.items():
        if variant.kind == TWO_STAGE and not variant.widening * setting.drift_density > 0.0:
            raise ConfigError(
                f"the channels of '{name}' follow the oscillator's drift alone, and it has none",
                key="oscillator",
                advice='give {"drift_density": 0.02} or more, or take "one_stage"',
            )
        if variant.kind == INTERVAL_MESSAGE and setting.inertial is None and setting.interval < 3:
            raise ConfigError(
                f"two integrations do not show range, rate and acceleration, which '{name}' needs without INS",
                key="interval_s",
                advice=f"give {3.0 * setting.truth.step_s:g} s or more, or an inertial system",
            )
        if not variant.has_filter and np.isnan(setting.solution).all():
            count = setting.truth.ranges.shape[1]
            few = f"there are {count} satellites" if count < 4 else "the satellites lie on one cone"
            raise ConfigError(
                f"'{name}' has no filter, its position is the least squares of four satellites or more: {few}",
                key="azimuth_deg",
                advice='give four satellites in different directions, or a receiver with INS as "one_stage"',
            )
    best = max(float(np.nanmax(profile)) for profile in cn0.values())
    if best < setting.least_cn0_dbhz:
        raise ConfigError(
            f"no channel is ever used: C/N0 is {best:g} dBHz at most",
            key="least_cn0_dbhz",
            advice="give a limit below it",
        )
