"""A flight's setup of the filter: from its equipment, its start and its logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from insgnss.antenna.equipment import installation, limits_of
from insgnss.antenna.installation import Installation
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.config.slow_errors import SlowErrorSizes
from insgnss.filter.layout import StateBlock
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.clock_groups import Pair, clock_groups, pairs_of
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.flight import Flight, FlightLogs
from insgnss.log.rinex.navigation import read_navigation
from insgnss.runs.antennas_on_demand import with_aid
from insgnss.sensors.fitting import fitted
from insgnss.sensors.start_from_fixes import refuse_live_without_gnss, started_without_gnss
from insgnss.tables import Event, NavigationData


def setup_filter(
    flight: Flight, logs: FlightLogs, config: FilterConfig, *, several: bool = True
) -> FilterSetup:
    """Return the filter's setup for a flight's logs: the input of the streaming engine to repeat a replay.

    ``several`` includes the attitude stage of [attitude], as yet without phases.
    """
    with_carrier = logs.gnss.carrier_cycles is not None
    config = _with_tags_of(flight, config)
    setup = _setup(flight, config, logs.navigation, pairs_of(logs.gnss), with_carrier=with_carrier)
    seen, base = len(logs.gnss.sv_names), flight.config.gnss.base is not None and logs.base is not None
    setup = replace(setup, products=logs.products, antennas=logs.antennas, n_satellites=seen, with_base=base)
    setup = setup.with_further(*fitted(flight.config, logs))
    if not flight.config.gnss.files:
        setup = started_without_gnss(setup, flight, logs)
    return with_aid(setup, flight) if several else setup


def engine_settings(
    flight: Flight | str | Path,
    filter: str | Path | FilterConfig = "tight",
    *,
    settings: Mapping[str, Any] | None = None,
    signals: Iterable[Pair] | None = None,
    carrier: bool = False,
    states: Sequence[StateBlock] = (),
) -> FilterSetup:
    """Return the input of ``Engine``, from a flight file: its equipment, its start and its navigation files.

    The inertial and GNSS logs are not opened: they are what the engine will be fed. With several antennas ([attitude])
    ``Engine.gnss`` takes the epochs of each.

    Parameters
    ----------
    flight : the flight or its file
    filter : a name in the library, a file, or the settings themselves
    settings : changed settings of the filter, as in ``replay``
    signals : constellation and RINEX code of all signals that the receiver will send, as ("G", "C1C"); when None every
    band of
        the filter's settings gets its clock, for each constellation that has an ephemeris
    carrier : whether the epochs will bring carrier phases; with several antennas they do
    states : further states that the filter is to estimate, as in ``replay``

    Raises
    ------
    ConfigError : the flight has position fixes alone
    """
    if not isinstance(flight, Flight):
        flight = Flight.load(flight)
    refuse_live_without_gnss(flight)
    config = filter_config(filter, settings)
    carrier = carrier or flight.config.attitude is not None
    beside = fitted(flight.config, None)
    wanted = config.measurements.signals_of()
    if not flight.config.gnss.navigation:
        setup = _setup(flight, config, None, _all_pairs(wanted, set(wanted)), with_carrier=carrier)
        return with_aid(setup.with_further(*beside).with_further(states), flight)
    navigation, _ = read_navigation(flight.config.gnss.navigation)
    orbits = navigation.state_vectors
    seen = (*navigation.ephemerides.sv_names, *(() if orbits is None else orbits.sv_names))
    pairs = _all_pairs(wanted, {name[0] for name in seen}) if signals is None else set(signals)
    setup = _setup(flight, config, navigation, pairs, with_carrier=carrier)
    return with_aid(setup.with_further(*beside).with_further(states), flight)


def installed(flight: Flight) -> tuple[Installation, list[Event]]:
    """Return the vehicle's antennas, and the events of their files."""
    gnss = flight.config.gnss
    return installation(gnss.antenna, flight.path.absolute().parent, gnss.lever_b)


def _with_slow_errors_of(flight: Flight, config: FilterConfig) -> FilterConfig:
    """Return the settings with the flight file's sizes of slow errors, unless the filter's were changed."""
    of_log = flight.config.gnss.slow_errors
    if of_log is None or config.slow_errors != SlowErrorSizes():
        return config
    return config.model_copy(update={"slow_errors": of_log})


def _with_tags_of(flight: Flight, config: FilterConfig) -> FilterConfig:
    """Return the settings with exact inertial tags where nothing is declared of them and fixes alone measure."""
    if config.process.imu_time_sigma_s is not None or flight.config.gnss.files:
        return config
    return config.model_copy(update={"process": config.process.model_copy(update={"imu_time_sigma_s": 0.0})})


def _all_pairs(signals: dict[str, tuple[str, ...]], letters: set[str]) -> set[Pair]:
    return {(letter, code) for letter in letters for code in signals.get(letter, ())}


def _setup(
    flight: Flight,
    config: FilterConfig,
    navigation: NavigationData | None,
    pairs: set[Pair],
    *,
    with_carrier: bool,
) -> FilterSetup:
    config = _with_slow_errors_of(flight, config)
    gnss, start, use = flight.config.gnss, flight.config.start, config.measurements
    given = None if start == "automatic" else start
    start_ns = None
    if given is not None and given.time_s is not None:
        start_ns = int(week_seconds_to_ns(flight.config.gps_week, given.time_s))
    return FilterSetup(
        config=config,
        grade=flight.imu_grade,
        oscillator=flight.oscillator,
        lever_arm_m=gnss.lever_b or (0.0, 0.0, 0.0),
        range_rate_lag_s=gnss.range_rate_lag_s,
        clock_groups=clock_groups(use.constellations, use.signals_of(), pairs, every_band=use.every_band),
        start=given,
        start_ns=start_ns,
        navigation=navigation,
        with_carrier=with_carrier,
        installation=installed(flight)[0],
        visibility_limits=limits_of(config.visibility),
    )
