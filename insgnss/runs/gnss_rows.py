"""A flight's GNSS log as the filter's rows, with the corrections that need more than the row: place, products, a base.

The ionosphere's models other than GPS's and the base station's corrections are evaluated here, before the filter, at
approximate places (single-point solutions, one a minute, good to tens of metres: below a millimetre of delay).
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import pymap3d

from insgnss.config.flight import Base
from insgnss.constants import NS_PER_S
from insgnss.errors import NavigationDataError
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import fix_epoch
from insgnss.gnss.differential import apply, differential_corrections
from insgnss.gnss.ionosphere_rows import ionosphere_growth, ionosphere_rows, serving_models
from insgnss.gnss.observation_rows import GnssRows, from_epoch
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import glonass_channels
from insgnss.log.flight import Flight, FlightLogs
from insgnss.tables import Event, Float64, GnssTable, Int64, NavigationData

_PLACE_EVERY_S: Final = 60.0
_EPOCHS_TRIED: Final = 50  # from each minute on, until one gives a fix
# Beyond it a metre of error in the ranges is dozens in the position; the usual limit of receivers
MAX_GDOP: Final = 30.0
PREPARED_MODELS: Final = ("nequick", "beidou", "own")
# of a block; a big log's temporary arrays then stay small, and no log of an hour at 1 Hz is cut
MOST_ROWS: Final = 1 << 16


def corrected_rows(setup: FilterSetup, logs: FlightLogs, flight: Flight) -> tuple[GnssRows, list[Event]]:
    """Return the rows of a flight's GNSS log with every correction that its settings ask for.

    Raises
    ------
    NavigationDataError : the ionosphere's model has no coefficients, no epoch says where the receiver is, or the base
        station has nothing for the flight
    """
    (rows,), events = row_blocks(setup, logs, flight, None)
    return rows, events


def row_blocks(
    setup: FilterSetup, logs: FlightLogs, flight: Flight, most_rows: int | None = MOST_ROWS
) -> tuple[list[GnssRows], list[Event]]:
    """Return the rows of ``corrected_rows`` in blocks of whole epochs with about ``most_rows`` rows; None: in one.

    Raises
    ------
    NavigationDataError : as ``corrected_rows``
    """
    gnss = logs.gnss
    cuts = block_cuts(gnss.t_ns, most_rows or len(gnss.t_ns))
    ionosphere_l1, correction_m, events = row_corrections(setup, logs, flight)
    blocks = []
    for first, last in itertools.pairwise(cuts):
        before = first
        if first > 0 and setup.with_carrier:  # a carrier's difference needs the epoch before
            before = int(np.searchsorted(gnss.t_ns, gnss.t_ns[first - 1]))
        part = slice(before, last)
        rows = setup.rows(
            gnss.take(part),
            setup.messages,
            ionosphere_l1=None if ionosphere_l1 is None else ionosphere_l1[part],
            correction_m=None if correction_m is None else correction_m[part],
        )
        blocks.append(from_epoch(rows, int(before < first)))
    return blocks, events


def block_cuts(t_ns: Int64, most_rows: int) -> list[int]:
    """Return the first row of each block of whole epochs with about ``most_rows`` rows, and the number of rows."""
    wanted = np.arange(most_rows, len(t_ns), max(most_rows, 1))
    starts = np.unique(np.searchsorted(t_ns, t_ns[wanted]))  # of the epochs that these rows belong to
    return [0, *starts[starts > 0].tolist(), len(t_ns)]


def row_corrections(
    setup: FilterSetup, logs: FlightLogs, flight: Flight
) -> tuple[Float64 | None, Float64 | None, list[Event]]:
    """Return the delays on L1, the base station's corrections of the ranges, each None if missing, and events.

    The delays are (n, 2) with their rates [m, m/s], the others (n,) [m].

    Raises
    ------
    NavigationDataError : as ``corrected_rows``
    """
    events: list[Event] = []
    model = setup.config.measurements.ionosphere
    navigation = setup.navigation
    ionosphere_l1: Float64 | None = None
    if model == "klobuchar" and setup.unmodelled_zenith_m > 0.0 and len(logs.gnss.t_ns):
        detail = (
            f"no coefficients of the ionosphere model: {setup.unmodelled_zenith_m:g} m at the zenith (one sigma) are"
            " left in the pseudoranges; name the day's navigation file"
        )
        events.append(Event(None, "no_ionosphere_model", detail))
    if model in PREPARED_MODELS:
        if navigation is None:
            raise _no_coefficients(model)
        served = serving_models(navigation, model)
        listed = ", ".join(f"{letter} {name}" for letter, name in served.items())
        events.append(Event(None, "ionosphere_models", listed))
        place_ns, place_e = approximate_places(setup, setup.rows(logs.gnss, navigation))
        sat = setup.states(logs.gnss, navigation).sat
        delay = ionosphere_rows(logs.gnss, navigation, model, place_ns, place_e, sat)
        ionosphere_l1 = np.column_stack([delay, ionosphere_growth(logs.gnss, delay)])
    correction_m: Float64 | None = None
    base = flight.config.gnss.base
    if base is not None and logs.base is not None:
        correction_m, base_events = base_corrections(setup, logs, base)
        events += base_events
    return ionosphere_l1, correction_m, events


def approximate_places(setup: FilterSetup, rows: GnssRows) -> tuple[Int64, Float64]:
    """Return times (k,) and antenna positions (k, 3), ECEF, about one a minute.

    Raises
    ------
    NavigationDataError : no epoch has a fix
    """
    par = setup.parameters()[0]
    wanted = np.arange(rows.epoch_ns[0], rows.epoch_ns[-1] + 1, int(_PLACE_EVERY_S * NS_PER_S))
    found_ns, found_e = [], []
    for start in np.searchsorted(rows.epoch_ns, wanted):
        for epoch in range(start, min(start + _EPOCHS_TRIED, len(rows.epoch_ns))):
            fix = fix_epoch(rows, epoch, par, setup.ties, MAX_GDOP)
            if fix is not None:
                found_ns.append(fix.t_ns)
                found_e.append(fix.r_a)
                break
    if not found_ns:
        raise NavigationDataError(
            "no epoch gives the position that the ionosphere model needs",
            key="measurements.ionosphere",
            advice="'insgnss check' shows satellites and ephemeris per epoch; ionosphere = 'klobuchar' needs none",
        )
    return np.array(found_ns, np.int64), np.array(found_e)


def base_corrections(setup: FilterSetup, logs: FlightLogs, base: Base) -> tuple[Float64, list[Event]]:
    """Return a base station's corrections of the flight's ranges (n,) [m], NaN where missing, and events.

    Satellite states, ionosphere and troposphere are the same on both sides, so that only what they miss is left.
    """
    assert logs.base is not None
    place_e = np.array(pymap3d.geodetic2ecef(base.lat_deg, base.lon_deg, base.h_m))
    oldest_s = setup.config.measurements.max_ephemeris_age_s
    messages = None if logs.navigation is None else broadcast_messages(logs.navigation, max_age_s=oldest_s)
    states = setup.states(logs.base, messages)
    corrections, events = differential_corrections(
        logs.base,
        place_e,
        states,
        setup.klobuchar if setup.config.measurements.ionosphere in ("klobuchar", *PREPARED_MODELS) else None,
        ionosphere_m=_at_base(setup, logs.base, place_e, states.sat),
        troposphere=setup.config.measurements.troposphere == "saastamoinen",
        weather=setup.weather,
        clock_per_signal=not base.same_receiver,
        channels=glonass_channels(logs.base, messages),
    )
    message = setup.states(logs.gnss, messages).message
    known = (message >= 0).any()  # else the log states where its satellites were, by the base's messages
    correction_m = apply(corrections, logs.gnss, message if known else None, base.max_age_s)
    share = float(np.mean(np.isfinite(correction_m))) if len(correction_m) else 0.0
    if share == 0.0:
        raise _no_corrections(base)
    events.append(Event(None, "base_station", f"{100.0 * share:.0f} % of the rows have a correction"))
    return correction_m, events


def _no_coefficients(model: str) -> NavigationDataError:
    return NavigationDataError(
        f"ionosphere = '{model}' needs the coefficients of a navigation message, and none is given",
        key="measurements.ionosphere",
        advice="name a navigation file under gnss.navigation, or set ionosphere = 'ionosphere_free' or 'none'",
    )


def _no_corrections(base: Base) -> NavigationDataError:
    return NavigationDataError(
        "the base station has no correction for any row of the flight",
        file=", ".join(map(str, base.files)),
        key="gnss.base",
        advice="check that both logs are of the same hours and signals, and the base's lat_deg, lon_deg, h_m",
    )


def _at_base(setup: FilterSetup, base: GnssTable, place_e: Float64, sat: Float64) -> Float64 | None:
    navigation: NavigationData | None = setup.navigation
    model = setup.config.measurements.ionosphere
    if model not in PREPARED_MODELS or navigation is None:
        return None
    t_ns: Int64 = base.t_ns[:1]
    return ionosphere_rows(base, navigation, model, t_ns, place_e[None, :], sat)
