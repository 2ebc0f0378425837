"""Which receiver holds until which C/N0 in a manoeuvre, and with what errors: Monte Carlo of closed loops.

| table | one row for each | columns |
|-------|------------------|---------|
| summary | receiver and C/N0 | variant cn0_dbhz js_db runs lost position_m velocity_mps attitude_deg channels_mps range_m rate_mps phase_rad nees nees_low nees_high cn0_estimated_dbhz |
| thresholds | receiver | variant cn0_dbhz low_dbhz high_dbhz js_db linear_cn0_dbhz linear_js_db |
| channels | receiver, C/N0 and channel | variant cn0_dbhz channel az_deg el_deg lost range_m rate_mps |
| searches | search of a channel whose signal was gone | variant cn0_dbhz run channel lost_s back_s tracked_s cn0_dbhz_back sd_delay_m off_m sd_rate_mps off_mps within_aperture cells |
| epochs | receiver, C/N0 and time | variant cn0_dbhz time_s position_m velocity_mps attitude_deg nees lost received_dbhz |

Every run begins with errors that its filter knows, settles for ``settle_s`` at the highest of 45 dBHz and the C/N0
asked for, and then has the C/N0 of its row. ``lost`` is the share of runs in which a channel lost lock: a phase beyond
0.75 of the discriminator's aperture, or without phase tracking one chip or 100 Hz for more than a second. Errors are
root mean squares of three axes together after settling, of the runs that held lock; ``range_m`` and ``rate_mps`` are
those of the replicas, ``channels_mps`` is the velocity by least squares of all range rates. ``nees`` is the squared
error of motion and clock over the filter's covariance, by state: 1 is right; its bounds hold 99.9 % of the time if the
filter is consistent, even if every run counted as one look.
``js_db`` = 10 lg of the code's rate over C/N0, thermal noise left out. The threshold is where half of the runs lose a
channel, with the interval that 95 % of such shares span, and beside it that of the linear theory.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy import stats

from insgnss.antenna.equipment import limits_of
from insgnss.antenna.installation import Installation
from insgnss.config.filter import Visibility
from insgnss.config.flight import ImuGrade
from insgnss.config.interference import InterferenceConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.errors import ConfigError
from insgnss.interference.linear_threshold import LOWEST_CN0_DBHZ
from insgnss.shown import Shown
from insgnss.studies import receiver_pictures
from insgnss.studies.jammed_sky import emitters_of, jammed_cn0_dbhz
from insgnss.studies.receiver_limits import linear_threshold_dbhz, threshold_table
from insgnss.studies.receiver_masking import Masking, gain_dbic
from insgnss.studies.receiver_runs import ReceiverRun, Setting, run_many, run_once
from insgnss.studies.receiver_scene import ReceiverOptions, Scene, scene_of
from insgnss.studies.receiver_search import SearchRow
from insgnss.studies.receiver_variants import USUAL_VARIANTS, VARIANTS, Variant, variant_of
from insgnss.studies.result_files import write_study
from insgnss.tables import Float64
from insgnss.tracking.admissible import seeded

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

CN0_DBHZ: Final = (45.0, 40.0, 35.0, 30.0, 25.0, 20.0)
SETTLED_DBHZ: Final = 45.0
_TABLES: Final = ("summary", "thresholds", "channels", "searches", "epochs")
_OF_SEVERAL_RUNS: Final = ("variant", "runs", "nees_low", "nees_high")
_SHARE: Final = 0.999  # of a consistent filter's NEES inside its bounds
Report = Callable[[int, int], None]


@dataclass(frozen=True, repr=False)
class ReceiverStudy(Shown):
    """What ``receiver_study`` gives. Tables are DataFrames, the module's text has their columns."""

    summary: pd.DataFrame
    thresholds: pd.DataFrame
    channels: pd.DataFrame
    searches: pd.DataFrame
    epochs: pd.DataFrame
    asked: dict[str, Any]

    def figure(self) -> Figure:
        """Return the picture: errors and share lost over C/N0, a line a receiver, linear theory beside them."""
        return receiver_pictures.error_figure(self.summary, self.thresholds, self._title())

    def epoch_figure(self) -> Figure:
        """Return the picture of errors and NEES over time, a line a receiver, at the lowest C/N0."""
        return receiver_pictures.epoch_figure(self.epochs, self._title())

    def figures(self) -> Mapping[str, Callable[[], Figure]]:
        """Return how to draw each picture, by its file's name."""
        return {"receiver_errors": self.figure, "receiver_epochs": self.epoch_figure}

    def save(self, folder: str | Path, *, pictures: bool = True) -> Path:
        """Write tables, settings and pictures as ``receiver_*`` into ``folder``; return it.

        Raises
        ------
        ResultError : the folder cannot be written
        """
        tables = {f"receiver_{name}": getattr(self, name) for name in _TABLES}
        told = json.dumps(self.asked, indent=1, default=str)
        return write_study(folder, tables, {"receiver_settings": told}, self.figures(), draws=pictures)

    def _title(self) -> str:
        imu = self.asked["imu"]
        return f"{self.asked['scenario']}, {self.asked['tracking']}, {'no INS' if imu is None else imu}"


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
    variants : names in ``receiver_variants.VARIANTS``, or variants of one's own
    tracking : "coherent" tracks the phase, "noncoherent" frequency and delay
    imu : a grade by name or itself; None: no inertial system
    oscillator : a name in the library, or {"drift_density": S} one-sided at the carrier [rad^2/s^3]
    cn0 : [dBHz], the same for all satellites
    runs : of each receiver and C/N0
    seed : of all noise; the result does not depend on ``threads``
    options : integration, interval of the second stage, signal, sky, latency ..., see ``ReceiverOptions``
    emitters : flown past, as in ``flown_margin``: by name in ``models/emitters``, a file, or itself. C/N0 of each
        channel is then what they leave of it, and the row's C/N0 the least of all; ``cn0`` does not count
    antennas : of the vehicle, towards satellites and emitters; None: 0 dBic everywhere. C/N0 is then that of 0 dBic
        and follows their gain; ``options.masking`` leaves out what they do not see
    report : is told how many of all cases are done

    Raises
    ------
    ConfigError, ModelError : an unknown name, numbers that make no sense, a motion shorter than the study
    """
    wanted = {name if isinstance(name, str) else name.words: variant_of(name) for name in variants}
    levels = _checked(cn0, runs, threads, wanted, with_ins=imu is not None)
    _check_code(wanted, tracking)
    scene = _masked(scene_of(scenario, tracking, imu, oscillator, options), options, antennas)
    profiles = _profiles(scene, levels, emitters, antennas)
    found: dict[tuple[str, float], list[ReceiverRun]] = {}
    for name, variant in wanted.items():
        for level, profile in profiles.items():
            found[name, level] = run_many(scene.setting, variant, profile, runs, seed, threads)
            if report is not None:
                report(len(found), len(wanted) * len(profiles))
    summary = pd.DataFrame([_summary_row(scene, name, level, of) for (name, level), of in found.items()])
    linear = {name: linear_threshold_dbhz(scene, variant) for name, variant in wanted.items()}
    return ReceiverStudy(
        summary,
        threshold_table(summary, linear, scene),
        pd.concat([_channel_rows(scene, name, level, of) for (name, level), of in found.items()]),
        _search_rows(found),
        pd.concat(
            [
                _epoch_rows(scene.setting, name, level, of, profiles[level])
                for (name, level), of in found.items()
            ]
        ),
        {
            "scenario": scene.name,
            "variants": list(wanted),
            "tracking": tracking,
            "imu": imu if imu is None or isinstance(imu, str) else imu.model_dump(),
            "oscillator": oscillator if isinstance(oscillator, str) else dict(oscillator),
            "cn0": list(profiles),
            "emitters": None if emitters is None else emitters_of(emitters).model_dump(mode="json"),
            "runs": runs,
            "seed": seed,
            "options": options.told(),
        },
    )


def receiver_row(
    scene: Scene,
    name: str,
    cn0_dbhz: float,
    seed: int,
    emitters: InterferenceConfig | str | Path | None = None,
) -> dict[str, float]:
    """Return one run of one receiver as a row: that of ``summary`` for this run alone, and when it lost lock.

    ``lost`` is 1 where a channel lost lock; errors are then not a number.

    Raises
    ------
    ConfigError : an unknown receiver, or one that the scene's tracking or its lack of an INS does not allow
    """
    wanted = {name: variant_of(name)}
    levels = _checked([cn0_dbhz], 1, 1, wanted, with_ins=scene.setting.inertial is not None)
    _check_code(wanted, "coherent" if scene.setting.channels.coherent else "noncoherent")
    (level, profile), *_ = _profiles(scene, levels, emitters, None).items()
    run = run_once(scene.setting, wanted[name], profile, seeded(seed, 0))
    row = _summary_row(scene, name, level, [run])
    kept = {key: float(value) for key, value in row.items() if key not in _OF_SEVERAL_RUNS}
    return kept | {"lost_s": float(run.lost_s.min())}


def _masked(scene: Scene, options: ReceiverOptions, antennas: Installation | None) -> Scene:
    """Return a scene whose receivers mask by attitude, where that is asked for.

    Raises
    ------
    ConfigError : no antennas or no inertial system to do it with
    """
    if not options.masking:
        return scene
    if antennas is None or scene.setting.inertial is None:
        advice = "give antennas, and an inertial system that tells the attitude"
        raise ConfigError("nothing tells which satellites are hidden", key="masking", advice=advice)
    masking = Masking(antennas, limits_of(Visibility()))
    return replace(scene, setting=replace(scene.setting, masking=masking))


def _profiles(
    scene: Scene,
    levels: list[float],
    emitters: InterferenceConfig | str | Path | None,
    antennas: Installation | None,
) -> dict[float, Float64]:
    """Return C/N0 over time, (n, 1) or (n, m), by the level that names it."""
    truth = scene.setting.truth
    gain = np.zeros((len(truth.t_s), 1)) if antennas is None else gain_dbic(truth, antennas)
    if emitters is not None:
        jammed = jammed_cn0_dbhz(truth, emitters_of(emitters), scene.start_s, antennas)
        return {round(float(jammed.min()), 2): jammed}
    profiles = {}
    for level in levels:
        profiles[level] = np.full((len(truth.t_s), 1), level)
        profiles[level][: scene.setting.settle] = max(SETTLED_DBHZ, level)
        profiles[level] = profiles[level] + gain
    return profiles


def _checked(
    cn0: Sequence[float], runs: int, threads: int, wanted: Mapping[str, Variant], *, with_ins: bool
) -> list[float]:
    """Return the levels of C/N0, the highest first.

    Raises
    ------
    ConfigError : the first thing that makes no sense
    """
    levels = sorted({float(x) for x in np.atleast_1d(np.asarray(cn0, float))}, reverse=True)
    if not levels or not all(LOWEST_CN0_DBHZ <= x <= 60.0 for x in levels):
        raise ConfigError(
            f"C/N0 of {', '.join(f'{x:g}' for x in levels) or 'nothing'} dBHz",
            key="cn0",
            advice=f"give {LOWEST_CN0_DBHZ:g} to 60 dBHz: below it no receiver tracks",
        )
    if not wanted:
        raise ConfigError("no receiver is asked for", key="variants", advice=f"known: {', '.join(VARIANTS)}")
    if runs < 1 or threads < 1:
        key = "runs" if runs < 1 else "threads"
        raise ConfigError("a whole number from 1 on is needed", key=key, advice="40 runs give a share to 8 %")
    aided = [name for name, variant in wanted.items() if variant.needs_ins]
    if aided and not with_ins:
        raise ConfigError(
            f"'{aided[0]}' is aided by an inertial system, and there is none",
            key="variants",
            advice='without INS there are "scalar" and "one_stage"',
        )
    return levels


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


def _after(setting: Setting) -> npt.NDArray[np.bool_]:
    """Return which records count."""
    steps = setting.record_every * np.arange((len(setting.truth.t_s) - 1) // setting.record_every + 1)
    return np.asarray(steps >= setting.settle)


def _rms(values: list[Float64]) -> float:
    """Return the root mean square of vectors (k, 3), all runs together; NaN without a run."""
    return math.sqrt(float(np.mean([np.sum(v**2, axis=1).mean() for v in values]))) if values else math.nan


def _held(runs: list[ReceiverRun]) -> list[ReceiverRun]:
    return [run for run in runs if not run.lost]


def _summary_row(scene: Scene, name: str, level: float, runs: list[ReceiverRun]) -> dict[str, Any]:
    """Return one row of ``summary``."""
    setting, held = scene.setting, _held(runs)
    after = _after(setting)
    error = [run.error[after] for run in held]
    replicas = np.sqrt(np.mean([run.rms**2 for run in held], axis=(0, 1))) if held else np.full(2, np.nan)
    states = int(np.isfinite(runs[0].sd[0]).sum())
    freedom = states * len(held)
    low, high = stats.chi2.interval(_SHARE, freedom) if freedom else (math.nan, math.nan)
    estimates = [run.cn0_dbhz for run in held if run.cn0_dbhz.size]
    return {
        "variant": name,
        "cn0_dbhz": level,
        "js_db": scene.js_db(level),
        "runs": len(runs),
        "lost": 1.0 - len(held) / len(runs),
        "position_m": _rms([e[:, 0:3] for e in error]),
        "velocity_mps": _rms([e[:, 3:6] for e in error]),
        "attitude_deg": math.degrees(_rms([e[:, 6:9] for e in error])),
        "channels_mps": _rms([run.least_squares[after, 3:6] for run in held]),
        "range_m": float(replicas[0]),
        "rate_mps": float(replicas[1]),
        "phase_rad": float(replicas[0]) * setting.channels.radians_per_m
        if setting.channels.coherent
        else math.nan,
        "nees": float(np.mean([run.nees[after].mean() for run in held])) if held and states else math.nan,
        "nees_low": low / max(freedom, 1),
        "nees_high": high / max(freedom, 1),
        "cn0_estimated_dbhz": float(np.nanmean([x[len(x) // 2 :] for x in estimates]))
        if estimates
        else math.nan,
    }


def _channel_rows(scene: Scene, name: str, level: float, runs: list[ReceiverRun]) -> pd.DataFrame:
    held = _held(runs)
    rms = (
        np.sqrt(np.mean([run.rms**2 for run in held], axis=0))
        if held
        else np.full((scene.channels, 2), np.nan)
    )
    lost = np.mean([np.isfinite(run.lost_s) for run in runs], axis=0)
    return pd.DataFrame(
        {
            "variant": name,
            "cn0_dbhz": level,
            "channel": np.arange(scene.channels),
            "az_deg": scene.azimuth_deg,
            "el_deg": scene.elevation_deg,
            "lost": lost,
            "range_m": rms[:, 0],
            "rate_mps": rms[:, 1],
        }
    )


def _search_rows(found: Mapping[tuple[str, float], list[ReceiverRun]]) -> pd.DataFrame:
    """Return the searches of all runs."""
    rows = [
        {"variant": name, "cn0_dbhz": level, "run": k, **row._asdict()}
        for (name, level), runs in found.items()
        for k, run in enumerate(runs)
        for row in run.searches
    ]
    return pd.DataFrame(rows, columns=["variant", "cn0_dbhz", "run", *SearchRow._fields])


def _epoch_rows(
    setting: Setting, name: str, level: float, runs: list[ReceiverRun], cn0_dbhz: Float64
) -> pd.DataFrame:
    """Return errors over time: of all runs, those that lost lock as well."""
    time_s = setting.record_every * setting.truth.step_s * np.arange(len(runs[0].error))
    squares = np.mean([run.error**2 for run in runs], axis=0)
    first = np.array([run.lost_s.min() for run in runs])
    return pd.DataFrame(
        {
            "variant": name,
            "cn0_dbhz": level,
            "time_s": time_s,
            "position_m": np.sqrt(squares[:, 0:3].sum(axis=1)),
            "velocity_mps": np.sqrt(squares[:, 3:6].sum(axis=1)),
            "attitude_deg": np.degrees(np.sqrt(squares[:, 6:9].sum(axis=1))),
            "nees": np.mean([run.nees for run in runs], axis=0),
            "lost": (first[:, None] <= time_s).mean(axis=0),
            "received_dbhz": cn0_dbhz[:: setting.record_every].mean(axis=1),
        }
    )
