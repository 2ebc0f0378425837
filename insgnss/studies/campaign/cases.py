"""Case functions of campaigns: pure functions of (case, seed) that return rows of numbers.

| name    | keys of the case, with what they are when not given | rows |
|---------|------------------------------------------------------|------|
| matched | imu "tactical", oscillator "tcxo", duration_s 120, imu_rate_hz 100, noise_factor 1, scenario "" (one of models/scenarios) | one an epoch looked at: NEES of each block, NIS, errors with their sigma |
| outage  | as matched but duration_s 400; length_s 30, every_s 60, satellites "", kinds "" (all; names parted by commas) | one a window: drift, error, sigma, time to come back |
| masking | scenario "sokolov_2015", imu, oscillator (those of the scenario), fault_tests true | one a way to treat hidden satellites: errors, false rows, delay of re-acquisition |
| receiver | scenario "manoeuvring_5g", variant "one_stage", tracking "coherent", imu "industrial" ("" for no INS), oscillator "tcxo" (or a number, its drift density), cn0_dbhz 40, emitters "" (a name or a file), and the numbers of ``ReceiverOptions`` | one: lost, lost_s, errors, offsets of the replicas, NEES (``receiver_study``) |

The seed alone makes the random numbers: the same (case, seed) gives the same rows on any worker.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any, Final

import numpy as np

from insgnss.config.library import scenario_config
from insgnss.errors import ConfigError
from insgnss.studies.campaign.tasks import CaseFunction, Row
from insgnss.studies.masking.banked_flight import BankedFlight
from insgnss.studies.masking.cases import CaseResult, fly
from insgnss.studies.matched_flight import BLOCKS, MatchedFlight, flight_in_memory
from insgnss.studies.outage.study import Periodic, outage_study
from insgnss.studies.outage.windows import Removal
from insgnss.studies.receiver.admission import unused_options
from insgnss.studies.receiver.comparison import case_flight, receiver_row
from insgnss.studies.receiver.flight import FlightRequest, ReceiverFlight
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.variants import VARIANTS
from insgnss.studies.scenario_equipment import filter_of, without_fault_tests

_AXES: Final = {"position": "m", "velocity": "mps", "attitude": "rad"}
_RECEIVER: Final[Mapping[str, Any]] = {
    "scenario": "manoeuvring_5g",
    "variant": "one_stage",
    "tracking": "coherent",
    "imu": "industrial",
    "oscillator": "tcxo",
    "cn0_dbhz": 40.0,
    "emitters": "",
}
_FLIGHT: Final[Mapping[str, Any]] = {
    "imu": "tactical",
    "oscillator": "tcxo",
    "duration_s": 120.0,
    "imu_rate_hz": 100.0,
    "noise_factor": 1.0,
}
_RECEIVER_OPTIONS: Final[Mapping[str, Any]] = {
    name: value for name, value in ReceiverOptions().told().items() if not isinstance(value, tuple)
}


def matched(case: Mapping[str, Any], seed: int) -> list[Row]:
    """Return one run of ``matched_flight``: a row for each evaluated epoch."""
    flight = _flight(_asked(case, {**_FLIGHT, "scenario": ""}))
    outcome = flight.run(flight.draw(np.random.default_rng([seed])))
    rows: list[Row] = []
    for k, look in enumerate(flight.looks):
        row: dict[str, float] = {"time_s": float(flight.simulator.tag_s[look])}
        row |= {f"nees_{name}": float(outcome.nees[k, i]) for i, name in enumerate(BLOCKS)}
        row |= {
            "nis_range": float(outcome.nis[0]),
            "nis_rate": float(outcome.nis[1]),
            "refused": outcome.n_refused,
        }
        for name, unit in _AXES.items():
            row[f"{name}_error_{unit}"] = float(np.linalg.norm(outcome.error[k, BLOCKS[name]]))
            row[f"{name}_sd_{unit}"] = float(np.linalg.norm(outcome.sd[k, BLOCKS[name]]))
        rows.append(row)
    return rows


def outage(case: Mapping[str, Any], seed: int) -> list[Row]:
    """Return the outage study of one drawn flight, started by itself: a row for each window."""
    windows = {"length_s": 30.0, "every_s": 60.0, "satellites": "", "kinds": ""}
    asked = _asked(case, {**_FLIGHT, "duration_s": 400.0, **windows})
    flight = _flight(asked)
    names = (tuple(filter(None, str(asked[key]).split(","))) for key in ("satellites", "kinds"))
    satellites, kinds = names
    study = outage_study(
        flight_in_memory(flight, flight.draw(np.random.default_rng([seed])).log),
        Periodic(float(asked["length_s"]), float(asked["every_s"])),
        Removal(satellites, (), kinds),
        filter=flight.setup.config,
        threads=1,
    )
    last = study.errors[study.errors["since_s"] < float(asked["length_s"])].groupby("window").last()
    errors = last["position_m"].to_dict()
    shown = ("end_m", "sd_end_m", "peak_m", "peak_mps", "sd_back_s", "drift_back_s")
    return [
        {
            "window": int(row["window"]),
            "from_s": float(row["from_s"]),
            **{name: float(row[name]) for name in shown},
            "error_end_m": float(errors.get(row["window"], np.nan)),
        }
        for row in study.windows.to_dict("records")
    ]


def _flight(asked: Mapping[str, Any]) -> MatchedFlight:
    """Return the matched flight of a case."""
    imu, clock, scenario = (str(asked.get(key, "")) for key in ("imu", "oscillator", "scenario"))
    numbers = {key: float(asked[key]) for key in ("duration_s", "imu_rate_hz", "noise_factor")}
    return _matched_flight(imu, clock, scenario or None, **numbers)


@lru_cache(maxsize=8)
def _matched_flight(imu: str, clock: str, scenario: str | None, **numbers: Any) -> MatchedFlight:
    """Return a flight; a worker computes the truth of each once."""
    return MatchedFlight.of(imu, clock, scenario=scenario, **numbers)


def masking(case: Mapping[str, Any], seed: int) -> list[Row]:
    """Return one flight of the masking study: a row for each way to treat satellites that may be hidden."""
    known = {"scenario": "sokolov_2015", "imu": "", "oscillator": "", "fault_tests": True}
    asked = _asked(case, known)
    flight = _banked_flight(str(asked["scenario"]), str(asked["imu"]), str(asked["oscillator"]))
    settings = filter_of(flight.scenario)
    settings = settings if asked["fault_tests"] else without_fault_tests(settings)
    return [_of_way(flight, result) for result in fly(flight, settings, np.random.default_rng([seed]))]


def require_used(case_name: str, cases: Iterable[Mapping[str, Any]]) -> None:
    """Refuse options of receivers that no case of a campaign uses.

    What makes no sense in a case's values, its run reports.

    Raises
    ------
    ConfigError : there is one
    """
    unused: dict[str, ConfigError] = {}
    used: set[str] = set()
    for case in cases if case_name == "receiver" else ():
        given = {name: case[name] for name in _RECEIVER_OPTIONS if name in case}
        asked = {**_RECEIVER, **case}
        variant = VARIANTS.get(str(asked["variant"]))
        if variant is not None:
            tracking, with_ins = str(asked["tracking"]), bool(asked["imu"])
            options, errors = ReceiverOptions(**given), dict[str, ConfigError]()
            with suppress(ConfigError):
                errors = unused_options(options, {"receiver": variant}, tracking, with_ins=with_ins)
            unused |= errors
            used |= set(given) - set(errors)
    for key, error in unused.items():
        if key not in used:
            raise error


def receiver(case: Mapping[str, Any], seed: int) -> list[Row]:
    """Return one run of a receiver of the laboratory in closed loops: one row."""
    asked = _asked(case, {**_RECEIVER, **_RECEIVER_OPTIONS})
    changed = tuple((name, case[name]) for name in _RECEIVER_OPTIONS if name in case)
    names = tuple(str(asked[key]) for key in ("scenario", "tracking", "imu", "variant", "emitters"))
    flight = _receiver_flight(names, asked["oscillator"], float(asked["cn0_dbhz"]), changed)
    return [receiver_row(flight, str(asked["variant"]), seed)]


@lru_cache(maxsize=8)
def _receiver_flight(
    names: tuple[str, ...], oscillator: str | float, cn0_dbhz: float, changed: tuple[tuple[str, Any], ...]
) -> ReceiverFlight:
    """Return a receiver's flight; ``names`` of the scenario, tracking, IMU, receiver and emitters."""
    scenario, tracking, imu, variant, emitters = names
    clock = oscillator if isinstance(oscillator, str) else {"drift_density": float(oscillator)}
    options = ReceiverOptions(**dict(changed))
    asked = FlightRequest(scenario, tracking, imu or None, clock, options, emitters or None)
    return case_flight(asked, variant, cn0_dbhz)


@lru_cache(maxsize=8)
def _banked_flight(scenario: str, imu: str, clock: str) -> BankedFlight:
    config = scenario_config(scenario)
    return BankedFlight.of(config, imu or config.equipment.imu, clock or config.equipment.oscillator)


def _of_way(flight: BankedFlight, result: CaseResult) -> Row:
    from_s, until_s = min(s.from_s for s in flight.spells), max(s.until_s for s in flight.spells)
    e, ledger = result.errors, result.measurements
    during, after = e["time_s"].between(from_s, until_s), e["time_s"] > until_s
    false = ledger["lock"] != ""
    delays = np.array([channel.delay_s for channel in result.channels])
    return {
        "way": result.case.name,
        "rms_during_m": float(np.sqrt(np.mean(e.loc[during, "error_m"] ** 2))),
        "rms_after_m": float(np.sqrt(np.mean(e.loc[after, "error_m"] ** 2))),
        "max_m": float(e["error_m"].max()),
        "false_rows": int(false.sum()),
        "believed": int((false & ledger["believed"]).sum()),
        "true_refused": int((~false & ~ledger["believed"]).sum()),
        "delay_mean_s": float(delays.mean()),
        "delay_max_s": float(delays.max()),
    }


def _asked(case: Mapping[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """Return a case with defaults for omitted keys; an unknown key is an error."""
    unknown = sorted(set(case) - set(known))
    if unknown:
        advice = f"the keys are {', '.join(known)}"
        raise ConfigError(f"the case has no key {unknown[0]!r}", key=unknown[0], advice=advice)
    return {**known, **case}


CASES: Final[Mapping[str, CaseFunction]] = {
    "matched": matched,
    "masking": masking,
    "outage": outage,
    "receiver": receiver,
}
