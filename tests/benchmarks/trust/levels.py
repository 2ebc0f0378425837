"""Rows of protection levels: how many errors are beyond their level.

Without a fault, with a faulty satellite, and with a faulty constellation: every other satellite is called a Galileo
satellite. No error lasts, neither in the simulation nor in the sigmas, and pseudorange errors are taken for white, as
they are, so that the levels are as tight as they can be. A run has 510 epochs: 500 seeds of the four rows are 10^6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.tables import EphemerisTable, Float64, GnssTable
from tests.benchmarks.trust.motions import scenario, straight, turn
from tests.benchmarks.trust.rows import Case, Check, Measure, Row, Spoiler

if TYPE_CHECKING:
    from tests.benchmarks.trust.flying import Flown

_TURNS: Final = tuple(
    move for side in (90.0, -90.0, 180.0, -120.0) for move in (turn(side, 30.0), straight(2.0))
)
_DURATION_S: Final = 52.0
_FAULT_S: Final = 15.0
_WHITE: Final = {"pseudorange_noise_m.correlation_time_s": 0.0}
_SKY: Final = '[sky]\nkind = "nominal"\nper_plane = 7'
# Seconds after the fault's begin and the rows' pseudoranges' errors [m] and their rates [m/s]
_Errors = Callable[[GnssTable, Float64, np.random.Generator], tuple[Float64, Float64]]

BEYOND: Final = ("beyond_hpl", "beyond_vpl")
LARGEST: Final = ("largest_h", "largest_v")


def _two_constellations(case: Case) -> Case:
    """Return a case of which every other satellite is another constellation's, its states in the observations."""
    gnss, navigation = case.gnss, case.navigation
    states = satellite_states(gnss, navigation)
    sat = np.column_stack([states.sat[:, :6], states.clock_m, states.drift_mps])
    names = tuple("GE"[k % 2] + name[1:] for k, name in enumerate(gnss.sv_names))
    none = {key: value[:0] for key, value in vars(navigation.ephemerides).items()}
    return replace(
        case,
        gnss=replace(gnss, sat=sat, sv_names=names),
        navigation=replace(navigation, ephemerides=EphemerisTable(**none)),
    )


def _spoilt(errors: _Errors) -> Spoiler:
    def spoil(case: Case, at_s: float, rng: np.random.Generator) -> Case:
        case = _two_constellations(case)
        gnss = case.gnss
        since_s = (gnss.t_ns - case.start_ns) / 1e9 - at_s
        of_range, of_rate = errors(gnss, np.maximum(since_s, 0.0), rng)
        on = since_s >= 0.0
        ranges = gnss.pseudorange_m + np.where(on, of_range, 0.0)
        rates = gnss.range_rate_mps + np.where(on, of_rate, 0.0)
        return replace(case, gnss=replace(gnss, pseudorange_m=ranges, range_rate_mps=rates))

    return spoil


def _none(gnss: GnssTable, since_s: Float64, rng: np.random.Generator) -> tuple[Float64, Float64]:
    return np.zeros(len(since_s)), np.zeros(len(since_s))


def _step(gnss: GnssTable, since_s: Float64, rng: np.random.Generator) -> tuple[Float64, Float64]:
    """A satellite's ranges are wrong by 5 to 300 m at once."""
    wrong = gnss.sv == rng.choice(np.unique(gnss.sv))
    return wrong * rng.choice([-1.0, 1.0]) * rng.uniform(5.0, 300.0), np.zeros(len(since_s))


def _ramp(gnss: GnssTable, since_s: Float64, rng: np.random.Generator) -> tuple[Float64, Float64]:
    """A satellite's ranges and range rates run away by 0.1 to 5 m/s."""
    wrong = gnss.sv == rng.choice(np.unique(gnss.sv))
    rate = wrong * rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(0.1), np.log(5.0)))
    return rate * since_s, rate


def _orbits(gnss: GnssTable, since_s: Float64, rng: np.random.Generator) -> tuple[Float64, Float64]:
    """All satellites of a constellation agree on a position that runs away by 0.1 to 2 m/s."""
    wrong = np.array([float(name.startswith("E")) for name in gnss.sv_names])[gnss.sv]
    v_e = rng.standard_normal(3)
    v_e *= np.exp(rng.uniform(np.log(0.1), np.log(2.0))) / np.linalg.norm(v_e)
    # the observer is taken to be below the middle of the satellites; only the directions to them count
    middle = gnss.sat[:, :3].mean(axis=0)
    towards = gnss.sat[:, :3] - 6.378e6 * middle / np.linalg.norm(middle)
    rate = wrong * (towards @ v_e) / np.linalg.norm(towards, axis=1)
    return rate * since_s, rate


def _ratios(flown: Flown) -> Float64:
    """Return the horizontal and the vertical error over their levels (2, n)."""
    errors, nav = flown.run.errors, flown.run.nav
    assert errors is not None
    both = errors.merge(nav[["time_s", "hpl_m", "vpl_m"]], on="time_s")
    horizontal = np.hypot(both["d_n_m"], both["d_e_m"]) / both["hpl_m"]
    return np.array([horizontal, both["d_d_m"].abs() / both["vpl_m"]])


def _of_levels(take: Callable[[Float64], float], axis: int) -> Measure:
    return lambda flown: float(take(_ratios(flown)[axis]))


def _beyond(ratio: Float64) -> float:
    return float((ratio > 1.0).sum())


def _level_row(name: str, title: str, errors: _Errors) -> Row:
    measures: dict[str, Measure] = {"rows": _of_levels(len, 0)}
    for axis in (0, 1):
        measures[BEYOND[axis]] = _of_levels(_beyond, axis)
        measures[LARGEST[axis]] = _of_levels(np.max, axis)
    return Row(
        name,
        title,
        scenario("levels", *_TURNS, grade="tactical", speed_mps=60.0, gnss=_SKY),
        tuple(Check(f"no error beyond {one[-3:].upper()}", "most", one, high=0.0) for one in BEYOND),
        gnss_rate_hz=10.0,
        duration_s=_DURATION_S,
        spoil=_spoilt(errors),
        origin_s=_FAULT_S,
        spread_s=_FAULT_S,
        measures=measures,
        settings=_WHITE,
        integrity=True,
        in_tests=True,
    )


def level_rows() -> tuple[Row, ...]:
    """Return all rows of this file."""
    return (
        _level_row("levels", "no fault", _none),
        _level_row("levels_step", "a satellite steps by 5 to 300 m", _step),
        _level_row("levels_ramp", "a satellite runs away by 0.1 to 5 m/s", _ramp),
        _level_row("levels_constellation", "a constellation runs away by 0.1 to 2 m/s", _orbits),
    )
