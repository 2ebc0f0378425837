"""The check of an [attitude] block before any filter runs: antenna positions, and the common data of their logs."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.attitude.array_observability import angle_lost, is_collinear
from insgnss.attitude.baselines import AntennaArray
from insgnss.attitude.vehicle import array_of_flight
from insgnss.config.flight import FurtherAntenna
from insgnss.constants import NS_PER_S
from insgnss.errors import InsGnssError
from insgnss.gnss.antenna_phases import MATCH_S
from insgnss.log.checks.report import Finding, from_error
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import read_further_antenna, require_carrier
from insgnss.tables import GnssTable, Int64

LONG_BASELINE_M: Final = 50.0
MIN_CYCLE_SATELLITES: Final = 4  # of one epoch, for whole cycles that one set alone fits


def antenna_findings(flight: Flight, main: GnssTable | None) -> list[Finding]:
    """Return the findings on the antennas; ``main`` is the log of [gnss], None where it cannot be read."""
    attitude = flight.config.attitude
    if attitude is None:
        return []
    findings = []
    try:
        array = array_of_flight(attitude, flight.config.gnss, flight.path.absolute().parent)
        findings += _array_findings(array)
    except InsGnssError as error:
        findings.append(from_error("attitude", error))
    if main is not None:
        try:
            require_carrier(main, "the log of [gnss]", flight.config.gnss.files[0])
        except InsGnssError as error:
            findings.append(from_error("attitude", error))
        for antenna in attitude.antenna:
            findings += _log_findings(flight, antenna, main)
    return findings


def _array_findings(array: AntennaArray) -> list[Finding]:
    lengths = ", ".join(
        f"{name} {length:.3f} m" for name, length in zip(array.names[1:], array.lengths_m, strict=True)
    )
    findings = [Finding("ok", "attitude", f"baselines from {array.names[0]}: {lengths}")]
    if array.lengths_m.max() > LONG_BASELINE_M:
        text = f"the longest baseline is {array.lengths_m.max():.0f} m"
        findings.append(Finding("warning", "attitude", text, "declare lever_arm_m in metres"))
    if is_collinear(array):
        text = f"the antennas are on one line: {angle_lost(array)} comes from the inertial sensors alone"
        findings.append(Finding("warning", "attitude", text, "add an antenna off the line to measure it too"))
    return findings


def _log_findings(flight: Flight, antenna: FurtherAntenna, main: GnssTable) -> list[Finding]:
    try:
        table, _ = read_further_antenna(flight.config, antenna, main)
    except InsGnssError as error:
        return [from_error("attitude", error)]
    own, others = (_epochs_and_satellites(log, main.sv_names) for log in (table, main))
    shared = own[np.isin(own, others)]
    if not len(shared):
        text = f"antenna {antenna.name}: no epoch and satellite in common with the main log"
        return [Finding("error", "attitude", text, "log all antennas at one rate, with the same signals")]
    counts = np.unique(shared // len(main.sv_names), return_counts=True)[1]
    epochs = len(np.unique(main.t_ns))
    text = (
        f"antenna {antenna.name}: phases of {counts.min()} to {counts.max()} satellites in common with the main"
        f" log in {len(counts)} of its {epochs} epochs"
    )
    few = np.median(counts) < MIN_CYCLE_SATELLITES
    advice = "with fewer than four satellites the integer ambiguities are rarely resolved" if few else ""
    return [Finding("warning" if few else "ok", "attitude", text, advice)]


def _epochs_and_satellites(log: GnssTable, names: tuple[str, ...]) -> Int64:
    """Return one number for each epoch and satellite that has a carrier phase, satellites counted as in ``names``."""
    if log.carrier_cycles is None:
        return np.zeros(0, np.int64)
    place = {name: i for i, name in enumerate(names)}
    number = np.array([place.get(name, -1) for name in log.sv_names], np.int64)[log.sv]
    epoch = np.rint(log.t_ns / NS_PER_S / MATCH_S).astype(np.int64)
    has_phase = np.isfinite(log.carrier_cycles) & (number >= 0)
    return np.unique(epoch[has_phase] * len(names) + number[has_phase])
