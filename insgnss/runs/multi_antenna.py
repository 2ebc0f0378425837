"""A flight's further antennas as the filter's attitude stage takes them, and its results for the ledger."""

from __future__ import annotations

import numpy as np
import pandas as pd

from insgnss.antenna.equipment import installation, limits_of, mounting
from insgnss.attitude.array_observability import angle_lost, is_collinear
from insgnss.attitude.vehicle import array_of_flight, mounted_antennas
from insgnss.config.flight import AttitudeConfig
from insgnss.filter.antennas.attitude import AttitudeAid
from insgnss.filter.antennas.data import AntennaData
from insgnss.filter.antennas.phase_log import KIND as KIND
from insgnss.filter.antennas.phase_log import PhaseLog
from insgnss.filter.antennas.rows import Antennas
from insgnss.filter.antennas.visibility import AntennaMasking
from insgnss.filter.setup import FilterSetup
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.flight import Flight
from insgnss.results.table_files import words
from insgnss.status import NAMES
from insgnss.tables import Event


def attitude_aid(setup: FilterSetup, flight: Flight, attitude: AttitudeConfig) -> AttitudeAid:
    """Return the attitude stage of the flight's antennas, still without phases.

    Raises
    ------
    ConfigError, ModelError, GeometryError : the antennas' places are not known, or two of them are one
    """
    gnss, folder = flight.config.gnss, flight.path.absolute().parent
    array = array_of_flight(attitude, gnss, folder)
    events = []
    if is_collinear(array):
        detail = f"the antennas are on one line: {angle_lost(array)} comes from the inertial sensors alone"
        events.append(Event(None, "attitude_collinear", detail))
    mounted = mounted_antennas(attitude, gnss, folder)
    antennas = Antennas(
        names=array.names,
        lever_b=array.positions_b,
        delay_m=np.array([0.0, *(antenna.delay_m for antenna in attitude.antenna)]),
        C_ba=np.stack([mounting(antenna) for antenna in mounted]),
        separate_clocks=attitude.clocks == "separate",
        phase_sigma_m=attitude.phase_sigma_m,
        multipath_sigma_m=attitude.multipath_sigma_m,
        phase_floor_m=attitude.phase_floor_m,
        phase_elevation_m=attitude.phase_elevation_m,
    )
    hiding = None
    stage = setup.config.visibility
    if (
        stage.on
        and not stage.use_masked
        and any(one.pattern != "isotropic" or one.obstruction is not None for one in mounted)
    ):
        seen = [installation([antenna], folder, gnss.lever_b) for antenna in mounted]
        events += [event for _, more_events in seen[1:] for event in more_events]
        hiding = AntennaMasking(tuple(one for one, _ in seen), limits_of(stage))
    data = AntennaData(
        antennas,
        *(attitude.multipath_time_s, attitude.ratio, attitude.confirmations, attitude.gate_sigma, hiding),
    )
    return AttitudeAid(data, tuple(events))


def with_differences(
    log: PhaseLog, antennas: tuple[str, ...], measurements: pd.DataFrame, week: int
) -> pd.DataFrame:
    """Return the ledger with the phases of the further antennas in it, in the order of time.

    The column ``antenna`` names the antenna of a difference; it is empty for all other measurements.
    """
    phases, ledger = log.phases, log.ledger
    own = np.flatnonzero(phases.antenna > 0)
    status, kinds = measurements["status"].cat.categories, measurements["kind"].cat.categories
    codes = {code: status.get_loc(name) for code, name in NAMES.items()}
    sv_names = tuple(measurements["sv"].cat.categories)
    signals = tuple(measurements["signal"].cat.categories)
    sv_names += tuple(sorted({sv for sv, _ in phases.names} - set(sv_names)))
    signals += tuple(sorted({code for _, code in phases.names} - set(signals)))
    sv = np.array([sv_names.index(name) for name, _ in phases.names], np.int64)
    signal = np.array([signals.index(code) for _, code in phases.names], np.int64)
    innovation, variance = ledger.innovation[own], ledger.variance[own]
    further = pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(phases.t_ns[own], week),
            "sv": words(sv[phases.channel[own]], sv_names),
            "signal": words(signal[phases.channel[own]], signals),
            "kind": words(np.full(len(own), len(kinds)), (*kinds, KIND)),
            "innovation": innovation,
            "sd_innovation": np.sqrt(variance),
            "nis": innovation**2 / variance,
            "status": words(np.array([codes[code] for code in ledger.status[own]]), tuple(status)),
            "antenna": words(phases.antenna[own], ("", *antennas[1:])),
        }
    )
    main = measurements.assign(antenna=words(np.zeros(len(measurements), int), ("", *antennas[1:])))
    for name in ("sv", "signal", "kind"):
        main[name] = main[name].cat.set_categories(further[name].cat.categories)
    both = pd.concat([main, further], ignore_index=True)
    return both.sort_values("time_s", kind="stable", ignore_index=True)
