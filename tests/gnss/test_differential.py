"""Corrections of a base station: what both receivers share goes out, what the base has of its own does not come in."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.gnss.differential import Corrections, apply, base_ranges, differential_corrections
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.gnss.range_model import AirModel
from insgnss.gnss.troposphere import STANDARD_WEATHER
from insgnss.simulation.sky import KLOBUCHAR, nominal_constellation
from insgnss.tables import EphemerisTable, Float64, GnssTable
from tests.gnss.broadcast_sample import copies

START_NS = (2268 * 604_800 + 4 * 86_400 + 46_800) * NS_PER_S
TRUTH = nominal_constellation(START_NS).ephemerides
COEFFICIENTS = np.array(KLOBUCHAR)
CODES = ("C1C", "C5Q")
FACTORS = {"C1C": 1.0, "C5Q": (1575.42 / 1176.45) ** 2}


def broadcast_with_errors(rng: np.random.Generator) -> EphemerisTable:
    """Return messages that are wrong: orbits by some 20 m along the track, clocks by some 10 m."""
    n = len(TRUTH.sv_names)
    return replace(
        TRUTH,
        m0=TRUTH.m0 + rng.normal(0.0, 20.0, n) / 2.66e7,
        af0=TRUTH.af0 + rng.normal(0.0, 10.0, n) / C_MPS,
    )


def place(lat_deg: float, lon_deg: float, h: float) -> Float64:
    r_e = np.empty(3)
    geodetic_to_ecef(math.radians(lat_deg), math.radians(lon_deg), h, r_e)
    return r_e


BASE, ROVER = place(48.0, 9.0, 400.0), place(48.05, 9.1, 300.0)


def log(r_e: Float64, seconds: Float64, clock_m: Float64, unmodelled: float = 1.3) -> GnssTable:
    """Return both signals of all satellites above 10 deg; the real air delays ``unmodelled`` times the models."""
    n_sv, n = len(TRUTH.sv_names), len(TRUTH.sv_names) * 2 * len(seconds)
    t_ns = START_NS + np.repeat(np.rint(seconds * NS_PER_S).astype(np.int64), n_sv * 2)
    none = np.full(n, np.nan)
    sv = np.tile(np.repeat(np.arange(n_sv), 2), len(seconds)).astype(np.int16)
    signal = np.tile([0, 1], n_sv * len(seconds)).astype(np.int16)
    gnss = GnssTable(t_ns, sv, signal, np.full(n, 2.2e7), none, none, none, TRUTH.sv_names, CODES)
    clock = np.repeat(clock_m, n_sv * 2)
    for _ in range(3):
        model, sine, vacuum = modelled(gnss, TRUTH, r_e)
        gnss = replace(gnss, pseudorange_m=clock + vacuum + unmodelled * (model - vacuum))
    return gnss.take(np.flatnonzero(sine > math.sin(math.radians(10.0))))


def modelled(gnss: GnssTable, eph: EphemerisTable, r_e: Float64) -> tuple[Float64, Float64, Float64]:
    """Return model of range, sine of elevation, and the model without air."""
    states = satellite_states(gnss, eph)
    n = len(gnss.t_ns)
    factor = np.array([FACTORS[code] for code in CODES])[gnss.signal]
    model, sine, vacuum = np.empty(n), np.empty(n), np.empty(n)
    for out, air in ((model, 1.0), (vacuum, 0.0)):
        base_ranges(
            gnss.t_ns,
            np.ascontiguousarray(states.sat),
            states.clock_m,
            r_e,
            AirModel(COEFFICIENTS, air * factor, air, STANDARD_WEATHER),
            np.full(n, np.nan),
            out,
            sine,
        )
    return model, sine, vacuum


def spread(gnss: GnssTable, residual: Float64) -> float:
    """Return the largest residual when the receiver's clock of each epoch is taken out."""
    out = residual.copy()
    for t in np.unique(gnss.t_ns):
        of_epoch = gnss.t_ns == t
        out[of_epoch] -= np.nanmedian(residual[of_epoch])
    return float(np.nanmax(np.abs(out)))


SECONDS = np.arange(0.0, 61.0, 10.0)


def corrections_of(base: GnssTable, eph: EphemerisTable, **options: object) -> Corrections:
    return differential_corrections(base, BASE, satellite_states(base, eph), COEFFICIENTS, **options)[0]


def test_shared_errors_of_orbit_clock_and_air_go_out(rng: np.random.Generator) -> None:
    """10 km apart: orbit errors of 20 m leave 1 cm, air that is 30 % thicker than the models a few cm."""
    eph = broadcast_with_errors(rng)
    base = log(BASE, SECONDS, np.full(len(SECONDS), 3000.0))
    rover = log(ROVER, SECONDS[:-1] + 3.7, np.full(len(SECONDS) - 1, -150.0))
    states = satellite_states(rover, eph)
    correction = apply(corrections_of(base, eph), rover, states.message, 30.0)
    assert np.isfinite(correction).mean() > 0.9
    residual = rover.pseudorange_m - modelled(rover, eph, ROVER)[0]
    known = np.isfinite(correction)
    assert spread(rover, np.where(known, residual, np.nan)) > 8.0
    assert spread(rover, residual - correction) < 0.08


def test_same_models_on_both_sides_must_matter(rng: np.random.Generator) -> None:
    """Without the troposphere at the base, 100 m of height remain: 3 cm at the zenith, more below."""
    base, rover = (log(r_e, SECONDS, np.zeros(len(SECONDS)), 1.0) for r_e in (BASE, ROVER))
    residual = rover.pseudorange_m - modelled(rover, TRUTH, ROVER)[0]
    same = apply(corrections_of(base, TRUTH), rover, None, 30.0)
    other = apply(corrections_of(base, TRUTH, troposphere=False), rover, None, 30.0)
    assert spread(rover, residual - same) < 1e-6
    assert spread(rover, residual - other) > 1.0


def test_clock_jump_of_the_base_does_not_enter() -> None:
    smooth, jumping = np.full(len(SECONDS), 50.0), np.full(len(SECONDS), 50.0)
    jumping[3:] += 1e-3 * C_MPS
    one, other = (corrections_of(log(BASE, SECONDS, clock), TRUTH) for clock in (smooth, jumping))
    # 1 ms later the satellites have moved, and so have the states at the time of transmission
    np.testing.assert_allclose(one.correction_m, other.correction_m, rtol=0, atol=1e-3)


def test_wrong_pseudorange_at_the_base_stays_with_its_satellite() -> None:
    base = log(BASE, SECONDS, np.zeros(len(SECONDS)), 1.0)
    bad = base.pseudorange_m.copy()
    victim = base.sv[0]
    bad[base.sv == victim] += 40.0
    table = corrections_of(replace(base, pseudorange_m=bad), TRUTH)
    assert table.correction_m[table.sv == victim] == pytest.approx(40.0, abs=0.01)
    assert np.abs(table.correction_m[table.sv != victim]).max() < 0.01


def test_absurd_residual_of_the_base_gives_no_correction_and_is_told() -> None:
    base = log(BASE, SECONDS, np.zeros(len(SECONDS)), 1.0)
    bad = base.pseudorange_m.copy()
    bad[0] += 5000.0
    gnss = replace(base, pseudorange_m=bad)
    table, events = differential_corrections(gnss, BASE, satellite_states(gnss, TRUTH), COEFFICIENTS)
    assert len(table.t_ns) == len(base.t_ns) - 1
    assert [event.kind for event in events] == ["base_refused"]
    assert base.sv_names[base.sv[0]] in events[0].detail


def test_satellite_missing_at_the_base_has_no_correction() -> None:
    base = log(BASE, SECONDS, np.zeros(len(SECONDS)))
    lost = base.sv[0]
    table = corrections_of(base.take(np.flatnonzero(base.sv != lost)), TRUTH)
    correction = apply(table, base, None, 30.0)
    np.testing.assert_array_equal(np.isnan(correction), base.sv == lost)


def test_signal_that_the_base_does_not_track_has_no_correction() -> None:
    base = log(BASE, SECONDS, np.zeros(len(SECONDS)))
    table = corrections_of(base.take(np.flatnonzero(base.signal == 0)), TRUTH)
    rover = replace(base, signal_names=("C1C", "C1W"))
    np.testing.assert_array_equal(np.isnan(apply(table, rover, None, 30.0)), base.signal == 1)


def test_few_satellites_of_a_constellation_give_nothing_and_are_told() -> None:
    base = log(BASE, SECONDS[:1], np.zeros(1))
    two = base.take(np.flatnonzero(np.isin(base.sv, np.unique(base.sv)[:2])))
    table, events = differential_corrections(two, BASE, satellite_states(two, TRUTH), COEFFICIENTS)
    assert len(table.t_ns) == 0
    assert [event.kind for event in events] == ["base_too_few"]


def table_of(t_s: list[float], values: list[float], message: list[int]) -> Corrections:
    n = len(t_s)
    t_ns = START_NS + np.array(t_s) * NS_PER_S
    zero = np.zeros(n, np.int16)
    return Corrections(
        ("G01",), ("C1C",), t_ns.astype(np.int64), zero, zero, np.array(message), np.array(values)
    )


def at(table: Corrections, seconds: list[float], message: list[int] | None, max_age_s: float) -> Float64:
    n = len(seconds)
    zero, none = np.zeros(n, np.int16), np.full(n, np.nan)
    t_ns = (START_NS + np.array(seconds) * NS_PER_S).astype(np.int64)
    rover = GnssTable(t_ns, zero, zero, none, none, none, none, ("G01",), ("C1C",))
    return apply(table, rover, None if message is None else np.array(message), max_age_s)


def test_correction_is_linear_in_time_and_held_no_longer_than_its_age() -> None:
    table = table_of([0.0, 10.0, 100.0], [1.0, 2.0, 5.0], [0, 0, 0])
    found = at(table, [-5.0, 0.0, 4.0, 10.0, 25.0, 55.0, 90.0, 100.0, 119.0, 121.0], None, 20.0)
    expected = [1.0, 1.0, 1.4, 2.0, 2.0, math.nan, 5.0, 5.0, 5.0, math.nan]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_correction_holds_for_its_own_message_alone() -> None:
    table = table_of([0.0, 10.0, 20.0], [1.0, 8.0, 8.0], [3, 4, 4])
    found = at(table, [5.0, 5.0, 5.0, 15.0, 15.0], [3, 4, 7, 4, 3], 30.0)
    np.testing.assert_allclose(found, [1.0, 8.0, math.nan, 8.0, math.nan], rtol=0, atol=1e-9)


def test_change_of_message_between_base_and_rover_leaves_no_step(rng: np.random.Generator) -> None:
    """Two messages of each satellite, both wrong by metres, the second one used from 30 s on."""
    rows = np.arange(len(TRUTH.sv_names))
    later = broadcast_with_errors(rng)
    both = copies(TRUTH, 0, sv_names=[*TRUTH.sv_names, *TRUTH.sv_names])
    merged = {
        name: np.concatenate([getattr(broadcast_with_errors(rng), name)[rows], getattr(later, name)[rows]])
        for name in vars(TRUTH)
        if name not in ("sv_names", "message")
    }
    merged["toe_ns"] = merged["toe_ns"] + np.repeat([-3600, 3660], len(rows)) * NS_PER_S
    shift = np.repeat([-3600.0, 3660.0], len(rows))
    merged["toc_ns"] = merged["toe_ns"]
    merged["m0"] = merged["m0"] + shift * (np.sqrt(3.986005e14) / merged["sqrt_a"] ** 3 + merged["delta_n"])
    merged["i0"] = merged["i0"] + shift * merged["idot"]
    merged["omega0"] = merged["omega0"] + shift * merged["omega_dot"]
    merged["toe_sow_s"] = merged["toe_sow_s"] + shift
    merged["af0"] = merged["af0"] + shift * merged["af1"]
    eph = replace(both, **merged)
    base = log(BASE, SECONDS, np.zeros(len(SECONDS)))
    rover = log(ROVER, np.arange(1.0, 60.0, 4.0), np.zeros(15))
    states = satellite_states(rover, eph)
    assert len(np.unique(states.message)) > len(np.unique(rover.sv))
    residual = rover.pseudorange_m - modelled(rover, eph, ROVER)[0]
    table = corrections_of(base, eph)
    assert spread(rover, residual - apply(table, rover, states.message, 30.0)) < 0.3
    assert spread(rover, residual - apply(table, rover, None, 30.0)) > 3.0


def test_clock_for_each_signal_takes_the_bases_own_delay_between_signals_out() -> None:
    base = log(BASE, SECONDS, np.zeros(len(SECONDS)), 1.0)
    biased = replace(base, pseudorange_m=base.pseudorange_m + 6.0 * (base.signal == 1))
    per_signal = corrections_of(biased, TRUTH, clock_per_signal=True)
    assert np.abs(per_signal.correction_m).max() < 0.01
    common = corrections_of(biased, TRUTH)
    steps = [np.median(common.correction_m[common.signal == k]) for k in (0, 1)]
    assert steps[1] - steps[0] == pytest.approx(6.0, abs=0.01)


def test_empty_base_gives_no_corrections() -> None:
    base = log(BASE, SECONDS[:1], np.zeros(1))
    empty = base.take(np.zeros(0, np.intp))
    table, events = differential_corrections(empty, BASE, satellite_states(empty, TRUTH), COEFFICIENTS)
    assert len(table.t_ns) == 0 and events == []
    assert np.isnan(apply(table, base, None, 30.0)).all()
