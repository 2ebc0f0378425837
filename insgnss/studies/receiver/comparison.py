"""Which receiver holds until which C/N0 in a manoeuvre, and with what errors: Monte Carlo of closed loops.

| table | one row for each | columns |
|-------|------------------|---------|
| summary | receiver and C/N0 | variant cn0_dbhz js_db runs lost position_m velocity_mps attitude_deg channels_mps range_m rate_mps phase_rad nees nees_low nees_high innovation_correlation cn0_estimated_dbhz unsettled linear_phase_rad linear_velocity_mps linear_attitude_deg linear_channels_mps |
| thresholds | receiver | variant cn0_dbhz low_dbhz high_dbhz js_db linear_cn0_dbhz linear_js_db |
| channels | receiver, C/N0 and channel | variant cn0_dbhz channel az_deg el_deg lost range_m rate_mps range_predicted_m rate_predicted_mps |
| searches | search of a channel whose signal was gone | variant cn0_dbhz run channel lost_s back_s tracked_s cn0_dbhz_back sd_delay_m off_m sd_rate_mps off_mps within_aperture cells |
| events | loss of the last channel, and its end | variant cn0_dbhz run time_s kind |
| epochs | receiver, C/N0 and time | variant cn0_dbhz time_s position_m velocity_mps attitude_deg position_sd_m velocity_sd_mps attitude_sd_deg nees lost tracked channel_m channel_mps received_dbhz |

Every run begins with errors that its filter knows, settles for ``settle_s`` at the highest of 45 dBHz and the C/N0
asked for, and then has the C/N0 of its row. Errors grow to their new level: a position without phase tracking in half a
minute to several minutes, receivers that track the phase in seconds. They are averaged from ``options.average_s`` on,
which is the same for all rows; where it is not given, from when the covariance that each filter predicts has settled at
the lowest C/N0 (``receiver.settling``), at most two minutes after the fall. ``unsettled`` names the errors of a row that
have not settled within the first tenth of the average: it is below the steady value. ``lost`` is the share of runs in which a channel lost lock: a phase beyond
0.75 of the discriminator's aperture, or without phase tracking one chip or 100 Hz for more than a second. Errors are
root mean squares of three axes together after settling, of the runs that held lock; ``range_m`` and ``rate_mps`` are
those of the replicas, ``range_predicted_m`` and ``rate_predicted_mps`` of the same by the covariance of the channel's
own filter (of one stage by h P h^T of its filter) and by the error of holding the newest inertial sample,
``channels_mps`` is the velocity by least squares of all range rates. ``nees`` is the squared
error of motion and clock over the filter's covariance, by state: 1 is right; its bounds hold 99.9 % of the time if the
filter is consistent, even if every run counted as one look.
``innovation_correlation`` is that of the ranges of successive updates, less the predicted ones: 0 of a filter whose
measurements are independent, up to 1 of one that counts the same information again and again.
Columns with ``_sd_`` are what the filters predict of these errors, one sigma; ``tracked`` is the share of the channels
that are neither lost nor looked for. ``channel_m`` and ``channel_mps`` are truth minus replica of one channel of the first run, that which is lost first.
``cn0_estimated_dbhz`` is the receiver's own estimate, on average over the second half of a run. A search begins when a channel's
signal is gone (``lost_s``) and ends when it is tracked again (``tracked_s``) after it came back (``back_s``): the window's
sigmas in delay and Doppler (``sd_delay_m``, ``sd_rate_mps``), how far the truth lay from its middle (``off_m``,
``off_mps``), whether that was inside the discriminators' aperture, and how many cells were looked at. A channel whose signal
is not back at the run's end has a row as well, whose ``back_s`` is inf; ``lost`` does not count it, as its filter coasts.
``events`` has the kinds ``all_channels_lost`` (the filter goes on by itself) and ``channel_tracked_again``.
``js_db`` = 10 lg of the code's rate over C/N0, thermal noise left out. The threshold is where half of the runs lose a
channel, with the interval that 95 % of such shares span, and that of the linear theory. The summary's columns ``linear_*``
are its errors (``receiver.linear_theory``): of phases that are tracked at a C/N0 that stays. They are NaN of what it
does not know: errors of a filter behind channels, a position, and the replicas of ``optimal``. Of aided channels (aided, two_stage,
optimal) the linear theory takes a residual INS error of 0.06 m/s^2 over 100 s and 0.1 m/s^2 white at 1 ms for any IMU;
that of one stage follows the IMU.

A number of the source that is not reached: the J/S of aided receivers without phase tracking, 36 to 42 dB (18 to 24
dBHz). The C/N0 at which they are lost depends on how long it stays low: half of the runs at 2 to 4 dBHz (optimal, one
stage) and 9 to 13 dBHz (two stages) on stairs of one and two decibels a minute. They hold longer than published, as
they know C/N0 and meet no multipath. The order of the receivers is the published one.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import pandas as pd

from insgnss.antenna.installation import Installation
from insgnss.config.flight import ImuGrade
from insgnss.config.interference import InterferenceConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.studies.receiver import pictures
from insgnss.studies.receiver.admission import checked_call, unused_options, wanted_variants
from insgnss.studies.receiver.antennas import emitters_of
from insgnss.studies.receiver.flight import FlightRequest, ReceiverFlight, receiver_flight
from insgnss.studies.receiver.linear_theory import NOTHING, LinearErrors, LinearTheory, threshold_table
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.runs import ReceiverRun, run_many, run_once
from insgnss.studies.receiver.saved_request import antenna_settings
from insgnss.studies.receiver.tables import channel_rows, epoch_rows, event_rows, search_rows, summary_row
from insgnss.studies.receiver.variants import USUAL_VARIANTS, VARIANTS, Variant, variant_of
from insgnss.studies.saved_study import SavedStudy
from insgnss.tracking.admissible import require_seed, seeded

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

CN0_DBHZ: Final = (45.0, 40.0, 35.0, 30.0, 25.0, 20.0)
_OF_SEVERAL_RUNS: Final = ("variant", "runs", "nees_low", "nees_high")
Report = Callable[[int, int], None]


@dataclass(frozen=True, repr=False)
class ReceiverStudy(SavedStudy):
    """The result of ``receiver_study``. Tables are DataFrames, the module's text has their columns.

    ``receiver_request`` reads from a saved study the arguments that repeat it.
    """

    PREFIX: ClassVar = "receiver_"
    TABLES: ClassVar = ("summary", "thresholds", "channels", "searches", "events", "epochs")
    PICTURES: ClassVar = {
        "receiver_errors": "figure",
        "receiver_epochs": "epoch_figure",
        "receiver_channel": "channel_figure",
    }

    summary: pd.DataFrame
    thresholds: pd.DataFrame
    channels: pd.DataFrame
    searches: pd.DataFrame
    events: pd.DataFrame
    epochs: pd.DataFrame
    asked: dict[str, Any]
    motion: SimulationConfig
    antennas: Installation | None

    def figure(self) -> Figure:
        """Return the picture: errors and share lost over C/N0, one line per receiver, with linear theory."""
        return pictures.error_figure(self.summary, self.thresholds, self._title())

    def epoch_figure(self) -> Figure:
        """Return the picture of errors and NEES over time, one line per receiver, at the lowest C/N0."""
        return pictures.epoch_figure(self.epochs, self._title())

    def channel_figure(self) -> Figure:
        """Return the picture of one channel's replica over time: the first that is lost in the first run."""
        options = self.asked["options"]
        cycle_m = C_MPS / float(options["carrier_hz"]) if self.asked["tracking"] == "coherent" else None
        return pictures.channel_figure(self.epochs, self._title(), cycle_m)

    def _settings(self) -> Mapping[str, Any]:
        motion = self.motion.model_dump(mode="json")
        return self.asked | {"scenario_settings": motion, "antennas": antenna_settings(self.antennas)}

    def _title(self) -> str:
        imu = self.asked["imu"]
        sensor = "no INS" if imu is None else imu if isinstance(imu, str) else "a given IMU grade"
        return f"{self.asked['scenario']}, {self.asked['tracking']}, {sensor}"


def receiver_study(
    scenario: str | Path | SimulationConfig = "manoeuvring_5g",
    *,
    variants: Sequence[str | Variant] = USUAL_VARIANTS,
    tracking: str = "coherent",
    imu: str | ImuGrade | None = "industrial",
    oscillator: str | Mapping[str, float] = "tcxo",
    cn0: Sequence[float] = CN0_DBHZ,
    runs: int = 40,
    seed: int = 1,
    options: ReceiverOptions = ReceiverOptions(),  # noqa: B008 - frozen
    emitters: InterferenceConfig | str | Path | None = None,
    antennas: Installation | None = None,
    threads: int = 2,
    report: Report | None = None,
) -> ReceiverStudy:
    """Return how receivers do along a scenario's motion, at several C/N0.

    Parameters
    ----------
    scenario : a list of manoeuvres by name in ``models/scenarios``, its file, or itself
    variants : names in ``insgnss.studies.receiver.variants.VARIANTS``, or variants of one's own
    tracking : "coherent" tracks the phase, "noncoherent" frequency and delay
    imu : a grade by name or itself; None: no inertial system
    oscillator : a name in the library, or {"drift_density": S} one-sided at the carrier [rad^2/s^3]
    cn0 : [dBHz], the same for all satellites
    runs : of each receiver and C/N0
    seed : of all noise; the result does not depend on ``threads``
    options : integration, interval of the second stage, signal, sky, latency ..., see ``ReceiverOptions``
    emitters : flown past, as in ``flown_margin``: by name in ``models/emitters``, a file, or itself. C/N0 of each
        channel is then the one they leave, and the row's C/N0 the least of all; ``cn0`` does not count
    antennas : of the vehicle, towards satellites and emitters; None: 0 dBic everywhere. C/N0 is then that of 0 dBic
        and follows their gain; ``options.masking`` leaves out what they do not see
    report : is called with the numbers of cases done and in total

    Raises
    ------
    ConfigError, ModelError : an unknown name, numbers that make no sense, a motion shorter than the study
    """
    wanted = wanted_variants(variants)
    levels = checked_call(cn0, {"runs": runs, "threads": threads}, wanted, with_ins=imu is not None)
    require_seed(seed)
    if report is not None and not callable(report):
        advice = "give a function of the numbers of cases done and in total, or None"
        raise ConfigError(f"{report!r} is not a function", key="report", advice=advice)
    _check_code(wanted, tracking)
    asked = FlightRequest(scenario, tracking, imu, oscillator, options, emitters, antennas)
    flight = receiver_flight(asked, wanted, levels, threads)
    for error in unused_options(asked.options, wanted, tracking, with_ins=asked.imu is not None).values():
        raise error
    scene, profiles = flight.scene, flight.profiles
    receiver_runs: dict[tuple[str, float], list[ReceiverRun]] = {}
    for name, variant in wanted.items():
        for level, profile in profiles.items():
            receiver_runs[name, level] = run_many(scene.setting, variant, profile, runs, seed, threads)
            if report is not None:
                report(len(receiver_runs), len(wanted) * len(profiles))
    theories = {name: LinearTheory.of(scene, variant) for name, variant in wanted.items()}
    linear = _linear_errors(theories, profiles, steady=emitters is None and antennas is None)
    summary = pd.DataFrame(
        [
            summary_row(scene, name, wanted[name], level, of)
            | {"unsettled": flight.unsettled.get((name, level), "")}
            | {f"linear_{key}": value for key, value in linear[name, level]._asdict().items()}
            for (name, level), of in receiver_runs.items()
        ]
    )
    return ReceiverStudy(
        summary,
        threshold_table(summary, {name: of.threshold_dbhz() for name, of in theories.items()}, scene),
        pd.concat([channel_rows(scene, name, level, of) for (name, level), of in receiver_runs.items()]),
        search_rows(receiver_runs),
        event_rows(receiver_runs),
        pd.concat(
            [
                epoch_rows(scene.setting, name, level, of, profiles[level])
                for (name, level), of in receiver_runs.items()
            ]
        ),
        {
            "scenario": scene.name,
            "begins_s": scene.begins_s,
            "variants": list(wanted),
            "own_variants": {name: asdict(of) for name, of in wanted.items() if VARIANTS.get(name) != of},
            "tracking": tracking,
            "imu": imu if imu is None or isinstance(imu, str) else imu.model_dump(),
            "oscillator": oscillator if isinstance(oscillator, str) else dict(oscillator),
            "cn0": list(profiles),
            "antennas": 0 if antennas is None else len(antennas.lever_b),
            "emitters": None if emitters is None else emitters_of(emitters).model_dump(mode="json"),
            "runs": runs,
            "seed": seed,
            "options": scene.options.told(),
        },
        scene.course.config,
        antennas,
    )


def _linear_errors(
    theories: Mapping[str, LinearTheory], levels: Iterable[float], *, steady: bool
) -> dict[tuple[str, float], LinearErrors]:
    """Return the linear theory's errors; nothing where C/N0 differs between channels or over time."""
    return {
        (name, level): theory.errors(level) if steady else NOTHING
        for name, theory in theories.items()
        for level in levels
    }


def case_flight(asked: FlightRequest, name: str, cn0_dbhz: float) -> ReceiverFlight:
    """Return the scenario of one receiver at one C/N0, for ``receiver_row``.

    Raises
    ------
    ConfigError : an unknown receiver, or one that the tracking or the lack of an INS does not allow
    """
    wanted = {name: variant_of(name)}
    levels = checked_call([cn0_dbhz], {}, wanted, with_ins=asked.imu is not None)
    _check_code(wanted, asked.tracking)
    return receiver_flight(asked, wanted, levels)


def receiver_row(flight: ReceiverFlight, name: str, seed: int) -> dict[str, float]:
    """Return one run of one receiver as a row: that of ``summary`` for this run alone, and when it lost lock.

    ``lost`` is 1 where a channel lost lock; errors are then not a number.
    """
    (level, profile), *_ = flight.profiles.items()
    variant = variant_of(name)
    run = run_once(flight.scene.setting, variant, profile, seeded(seed, 0))
    row = summary_row(flight.scene, name, variant, level, [run])
    values = {key: float(value) for key, value in row.items() if key not in _OF_SEVERAL_RUNS}
    return values | {"lost_s": float(run.lost_s.min())}


def _check_code(wanted: Mapping[str, Variant], tracking: str) -> None:
    """Refuse a receiver of code and phase that does not track the phase.

    Raises
    ------
    ConfigError : there is one
    """
    with_code = [name for name, variant in wanted.items() if variant.with_code]
    if with_code and tracking != "coherent":
        raise ConfigError(
            f"'{with_code[0]}' has a state for each phase, and no phase is tracked",
            key="variants",
            advice='give tracking = "coherent", or take "one_stage", whose rows are the code\'s then',
        )
