"""The cases of a masking study, and one flight's result in each: errors and the status of false rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import FlightConfig, Gnss, ImuConfig
from insgnss.config.slow_errors import NO_SLOW_ERRORS
from insgnss.log.flight import FlightInMemory, FlightLogs
from insgnss.results.nav_columns import POSITION
from insgnss.runs.replay import replay
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.faults import outage
from insgnss.simulation.observations import Fault
from insgnss.simulation.sky_law import table_with_states
from insgnss.studies.masking.banked_flight import SCENARIO_WEEK, START_NS, BankedFlight, FlightDraw
from insgnss.studies.masking.receiver_channels import (
    SEARCHED,
    ChannelSpell,
    SupervisedChannels,
    supervised_channels,
    supervised_channels_of,
    unsupervised_channels,
)
from insgnss.studies.saved_study import MOMENT_DECIMALS
from insgnss.studies.scenario_equipment import antennas_of
from insgnss.tables import GnssTable

_NO_MASK_DEG: Final = -90.0
_BELIEVED: Final = ("used", "used_for_start")


class Case(NamedTuple):
    """One way to treat satellites that may be hidden."""

    name: str
    words: str
    elevation_mask: bool
    stage: bool  # attitude-aware masking in the filter
    supervised: bool  # the receiver's channels


CASES: Final = (
    Case("a", "no masking", False, False, False),
    Case("b", "elevation mask", True, False, False),
    Case("c", "attitude-aware masking", True, True, False),
    Case("d", "masking and supervision", True, True, True),
)


@dataclass(frozen=True)
class CaseResult:
    """One flight in one case."""

    case: Case
    channels: tuple[ChannelSpell, ...]
    errors: pd.DataFrame  # time_s error_m sd_m d_n_m d_e_m d_d_m, at the epochs
    measurements: pd.DataFrame  # the ledger, with ``lock``: the false lock behind a row, "" for a true one


def fly(
    flight: BankedFlight, filter: FilterConfig, rng: np.random.Generator, cases: Sequence[Case] = CASES
) -> list[CaseResult]:
    """Return one draw of a flight in each case: the same errors, the same false locks, the same filter.

    The supervisor uses a filter over the log of a receiver that measures only what it receives: no row while a
    satellite is hidden or its loops pull in.
    """
    drawn = flight.draw(rng)
    alone = unsupervised_channels(flight.scenario, flight.spells, rng)
    logs = {False: _log(drawn, [fault for c in alone for fault in c.faults()])}
    channels = {False: alone}
    if any(case.supervised for case in cases):
        states = _supervised(flight, filter, drawn)
        logs[True] = _log(drawn, _gaps(flight), states)
        channels[True] = supervised_channels(flight.spells, states.t_s, states.sv_names, states.supervision)
    results = []
    for case in cases:
        run = replay(
            _flight_in_memory(flight, drawn, logs[case.supervised]),
            _settings(filter, flight.scenario.flight.elevation_mask_deg, case),
        )
        spells = tuple(channels[case.supervised])
        results.append(CaseResult(case, spells, _errors(run), _marked(run, spells)))
    return results


def _settings(filter: FilterConfig, mask_deg: float, case: Case) -> FilterConfig:
    mask = mask_deg if case.elevation_mask else _NO_MASK_DEG
    return filter.model_copy(
        update={
            "measurements": filter.measurements.model_copy(update={"elevation_mask_deg": mask}),
            "visibility": filter.visibility.model_copy(update={"on": case.stage}),
        }
    )


def _gaps(flight: BankedFlight) -> list[Fault]:
    """Return the faults of a receiver that has no row while a satellite is hidden."""
    return [outage([spell.sv], spell.from_s, spell.until_s) for spell in flight.spells]


def _supervised(flight: BankedFlight, filter: FilterConfig, drawn: FlightDraw) -> SupervisedChannels:
    """Return the supervisor's decisions on the flight."""
    pull_in_s = flight.scenario.search.guards.pull_in_s
    gaps = [outage([s.sv], s.from_s, s.until_s + pull_in_s) for s in flight.spells]
    gnss = _log(drawn, gaps)
    config = _settings(filter, flight.scenario.flight.elevation_mask_deg, CASES[-1])
    flown = _flight_in_memory(flight, drawn, gnss)
    setup = setup_filter(flown, flown.logs, config)
    return supervised_channels_of(flight.scenario, flight.sky, flight.spells, setup, drawn.imu, gnss)


def _log(drawn: FlightDraw, faults: Sequence[Fault], channels: SupervisedChannels | None = None) -> GnssTable:
    """Return the receiver's log: what was observed, with faults, of the channels that track."""
    observations = drawn.observations
    for fault in faults:
        observations = fault(observations)
    if channels is not None:
        observations = channels.lets_through(observations)
    return table_with_states(observations, drawn.paths, START_NS)


def _flight_in_memory(flight: BankedFlight, drawn: FlightDraw, gnss: GnssTable) -> FlightInMemory:
    config = FlightConfig(
        name=flight.scenario.name,
        gps_week=SCENARIO_WEEK,
        imu=ImuConfig(files=(Path("imu.csv"),), grade=flight.grade),
        gnss=Gnss(
            files=(Path("gnss.csv"),),
            lever_arm_m=(0.0, 0.0, 0.0),
            oscillator=flight.oscillator,
            antenna=antennas_of(flight.scenario),
            slow_errors=NO_SLOW_ERRORS,
        ),
        start=drawn.start,
    )
    logs = FlightLogs(
        imu=drawn.imu,
        gnss=gnss,
        navigation=None,
        reference=flight.reference,
        events=[],
        input_hashes={},
    )
    return FlightInMemory(Path("flight.toml"), config, flight.grade, flight.oscillator, logs)


def _errors(run: Run) -> pd.DataFrame:
    """Return distance from the truth and its sigma at the epochs."""
    assert run.errors is not None  # a flight in memory has its reference
    parts = run.errors[[f"d_{name}" for name in POSITION]]
    sigmas = run.errors[[f"sd_{name}" for name in POSITION]].to_numpy()
    size = np.linalg.norm(parts.to_numpy(), axis=1)
    table = pd.DataFrame({"time_s": run.errors["time_s"], "error_m": size})
    return table.assign(sd_m=np.linalg.norm(sigmas, axis=1), **parts)


def _marked(run: Run, channels: Sequence[ChannelSpell]) -> pd.DataFrame:
    """Return the ledger with the name of the false lock behind each row."""
    table = run.measurements.astype({"sv": "str", "kind": "str", "status": "str", "signal": "str"})
    lock = np.full(len(table), "", dtype=object)
    time_s, sv = np.round(table["time_s"].to_numpy(), MOMENT_DECIMALS), table["sv"].to_numpy()
    for channel in channels:
        within = (time_s >= channel.false_from_s) & (time_s < channel.false_until_s)
        if channel.lock != SEARCHED:
            lock[within & (sv == channel.sv)] = channel.lock
    return table.assign(lock=lock, believed=table["status"].isin(_BELIEVED))
