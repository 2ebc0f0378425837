"""One call: from a run and emitters to J/S, effective C/N0, margins and lock of every satellite over time.

| table      | one row per        | columns |
|------------|--------------------|---------|
| satellites | satellite and time | time_s sv el_deg gain_dbic js_db cn0_dbhz cn0_effective_dbhz, and for the loop without (_unaided) and with aiding (_aided): order_* drift_*_rad2ps3 threshold_*_dbhz reserve_*_db js_limit_*_db lock_* |
| emitters   | emitter and time   | time_s emitter distance_m az_deg el_deg body_az_deg body_el_deg gain_dbic received_dbw in_sight |
| events     | event              | time_s kind detail |

``js_db`` is the power of all emitters over the satellite's, both at the antenna's output; ``js_limit`` the J/S of the
same mixture at which the loop would lose lock; ``reserve`` the effective C/N0 above the loop's threshold. The filter
itself is not run again: the aiding's sigmas are those of the saved run, so a long time without any lock is worse,
and a loop that lost lock counts as in lock again as soon as it could keep it.
Both loops are optimal for what they face at that time: of the best loops of second and third order the better one
counts, ``order`` says which. The third order carries the acceleration as a state, which a second-order loop can only
widen its band for: in a turn it is worth up to 3 dB. ``drift`` is the Wiener drift that has the same threshold by (18).
In straight flight with a very good oscillator the loop without aiding can come out ahead: it faces no acceleration
then, while the aiding's own error stays.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pandas as pd

from insgnss.antenna.equipment import installation
from insgnss.antenna.installation import Installation, no_antenna
from insgnss.config.flight import MountedAntenna
from insgnss.config.interference import InterferenceConfig
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError
from insgnss.geodesy.directions import angle_columns, directions
from insgnss.interference.margin import db, ratio
from insgnss.results.nav_columns import EVENT
from insgnss.results.shown import ResultDisplay
from insgnss.results.table_files import save_study, table_files
from insgnss.runs.datum import label_as
from insgnss.runs.margin.link import Link, emitter_gain, link
from insgnss.runs.margin.loops import Disturbances, SignalLoop, disturbances, signal_loop, unaided_and_aided
from insgnss.runs.margin.path import FlownPath, aiding_sigma, flown_path
from insgnss.runs.result import Run
from insgnss.tables import Float64, stretches_of

TABLES: Final = ("satellites", "emitters", "events")
FILES: Final = table_files(f"margin_{name}" for name in TABLES)
STUDY_NAME: Final = "margin study"  # in the record of a folder
LOOPS: Final = ("unaided", "aided")


@dataclass(frozen=True, repr=False)
class FlownMargin(ResultDisplay):
    """The result of ``flown_margin``. Tables are DataFrames."""

    satellites: pd.DataFrame
    emitters: pd.DataFrame
    events: pd.DataFrame
    settings: InterferenceConfig

    def save(self, folder: str | Path, format: Literal["parquet", "csv"] = "parquet") -> Path:
        """Write the tables as ``margin_*`` into ``folder`` (made if needed); return the folder.

        Raises
        ------
        ResultError : the folder cannot be written, or another program's file has one of the names
        """
        tables = {f"margin_{name}": getattr(self, name) for name in TABLES}
        return save_study(folder, tables, format, STUDY_NAME)

    def summary(self) -> pd.DataFrame:
        """Return, per satellite, the largest J/S, the least reserves and the share of the time that each loop locks."""
        groups = self.satellites.groupby("sv", observed=True)
        columns = {"js_max_db": groups["js_db"].max()}
        for loop in LOOPS:
            columns[f"reserve_{loop}_min_db"] = groups[f"reserve_{loop}_db"].min()
            columns[f"lock_{loop}_share"] = groups[f"lock_{loop}"].mean()
        return pd.DataFrame(columns)

    def in_lock(self) -> pd.DataFrame:
        """Return, per time, how many satellites there are and how many each loop locks."""
        counts = self.satellites.groupby("time_s")[[f"lock_{loop}" for loop in LOOPS]].sum()
        return counts.assign(n_satellites=self.satellites.groupby("time_s").size()).reset_index()


def flown_margin(
    run: Run,
    emitters: InterferenceConfig | str | Path,
    *,
    antennas: Installation | None = None,
    step_s: float = 1.0,
) -> FlownMargin:
    """Return the effect of emitters on the phase loops of every satellite along a run's path.

    Equation: 1/q = N_0 / C + sum over emitters of (J/S) kappa; lock while 1/q is below that of the threshold, which is
    (18) of the second order or the Riccati equation of the third, the larger, with (19) or (20), for the drift and the
    acceleration that the loop has to follow at that time.

    Parameters
    ----------
    run : its tables nav and satellites; ``run.aiding``, where it has one, gives the uncertainty of the aiding,
        else the sigmas of tilt and accelerometer biases bound it
    emitters : settings, or their file (TOML)
    antennas : ``insgnss.antenna.equipment.installation``; those of the run's flight file when None
    step_s : least time between two rows; 0 takes every epoch

    Raises
    ------
    InsGnssError : the settings, a signal's name or the run's tables are wrong
    """
    config = (
        emitters
        if isinstance(emitters, InterferenceConfig)
        else load_toml(Path(emitters), InterferenceConfig)
    )
    if not (math.isfinite(step_s) and step_s >= 0.0):
        raise ConfigError(f"invalid step {step_s}", key="step_s", advice="give seconds, 0 for every epoch")
    path, rows = flown_path(run, step_s, config.dynamics.window_s)
    events: list[tuple[float, str, str]] = []
    if antennas is None:
        antennas = _antennas_of(run, float(path.time_s[0]), events)
    links = link(path, config.emitter, config.receiver, antennas)
    gain = rows["gain_dbi"].to_numpy(np.float64)
    seen = emitter_gain(path.C_nb[rows["at"]], _directions(rows)[:, None, :], antennas, 0.0)[:, 0]
    gain = np.where(np.isnan(gain), seen, gain)
    sigma = aiding_sigma(run, rows)
    if np.isnan(sigma).all():
        detail = (
            "the run has no aiding table: its residual acceleration is bounded by tilt and accelerometer bias"
        )
        events.append((float(path.time_s[0]), "aiding_absent", detail))
    residual = np.where(np.isnan(sigma), path.accel_sigma[rows["at"]], sigma)
    table = _satellite_table(run, path, rows, links, gain, residual, disturbances(run, config), config)
    events += _spells(table) + _never_in_sight(path, links, config)
    events.sort(key=lambda event: event[0])
    event_table = pd.DataFrame(events, columns=list(EVENT))
    label_as(table, run.nav)
    return FlownMargin(table, _emitter_table(path, links, config), event_table, config)


def _antennas_of(run: Run, begin_s: float, events: list[tuple[float, str, str]]) -> Installation:
    """Return the antennas that the run's flight file describes."""
    gnss: Any = run.settings.get("flight", {}).get("gnss", {})
    named = tuple(MountedAntenna.model_validate(dict(entry)) for entry in gnss.get("antenna", ()))
    if not named:
        events.append((begin_s, "antenna_unknown", "no antenna is described: 0 dBic in every direction"))
        return no_antenna()
    return installation(named, Path.cwd())[0]


def _satellite_table(
    run: Run,
    path: FlownPath,
    rows: pd.DataFrame,
    links: Link,
    gain: Float64,
    residual: Float64,
    disturbed: Disturbances,
    config: InterferenceConfig,
) -> pd.DataFrame:
    """Return one row per satellite and time."""
    at, receiver = rows["at"].to_numpy(), config.receiver
    cn0 = receiver.cn0_dbhz + gain
    motion = _along_sight(path.motion[at], rows)
    js = ratio(links.received_dbw[at] - (receiver.signal_dbw + gain)[:, None])  # (rows, m), zero for -inf
    columns: dict[str, Any] = {
        "time_s": rows["time_s"].to_numpy(np.float64),
        "sv": rows["sv"].astype("str").astype("category"),
        "el_deg": rows["el_deg"].to_numpy(np.float64),
        "gain_dbic": gain,
        "js_db": db(js.sum(axis=1)),
        "cn0_dbhz": cn0,
    }
    inverse, kappa, numbers = np.empty(len(rows)), np.full(len(rows), np.nan), np.empty((2, 3, len(rows)))
    for sv, loop in _loops(run, rows, config).items():
        mine = (rows["sv"].astype("str") == sv).to_numpy()
        added = js[mine] @ loop.separation
        inverse[mine] = ratio(-cn0[mine]) + added
        with np.errstate(divide="ignore", invalid="ignore"):
            kappa[mine] = added / js[mine].sum(axis=1)
        numbers[:, :, mine] = unaided_and_aided(loop, disturbed, motion[mine], residual[mine], config)
    columns["cn0_effective_dbhz"] = -db(inverse)
    for k, name in enumerate(LOOPS):
        drift, threshold, order = numbers[k]
        columns[f"order_{name}"] = order.astype(np.int64)
        columns[f"drift_{name}_rad2ps3"] = drift
        columns[f"threshold_{name}_dbhz"] = -db(threshold)
        columns[f"reserve_{name}_db"] = db(threshold) - db(inverse)
        with np.errstate(divide="ignore", invalid="ignore"):
            columns[f"js_limit_{name}_db"] = db(np.maximum(threshold - ratio(-cn0), 0.0) / kappa)
        columns[f"lock_{name}"] = inverse < threshold
    return pd.DataFrame(columns)


def _loops(run: Run, rows: pd.DataFrame, config: InterferenceConfig) -> dict[str, SignalLoop]:
    channels: Any = run.settings.get("flight", {}).get("gnss", {}).get("glonass_channels", {})
    names = sorted(rows["sv"].astype("str").unique())
    return {sv: signal_loop(sv, config.receiver, config.emitter, channels) for sv in names}


def _along_sight(motion: Float64, rows: pd.DataFrame) -> Float64:
    """Return the rms of the vehicle's acceleration along each line of sight [m/s^2]."""
    u_n = _directions(rows)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", u_n, motion, u_n), 0.0)))


def _directions(rows: pd.DataFrame) -> Float64:
    """Return unit lines of sight (n, 3), north-east-down."""
    return directions(rows["az_deg"].to_numpy(np.float64), rows["el_deg"].to_numpy(np.float64))


def _emitter_table(path: FlownPath, links: Link, config: InterferenceConfig) -> pd.DataFrame:
    n, m = links.distance_m.shape
    names = [emitter.name or f"emitter {k + 1}" for k, emitter in enumerate(config.emitter)]
    columns: dict[str, Any] = {
        "time_s": np.repeat(path.time_s, m),
        "emitter": pd.Categorical(np.tile(np.array(names, dtype=object), n)),
        "distance_m": links.distance_m.ravel(),
    }
    columns |= angle_columns(links.u_n.reshape(-1, 3)) | angle_columns(links.u_b.reshape(-1, 3), "body_")
    columns["gain_dbic"] = links.gain_dbic.ravel()
    columns["received_dbw"] = links.received_dbw.ravel()
    columns["in_sight"] = links.in_sight.ravel() > 0.0
    return pd.DataFrame(columns)


def _spells(table: pd.DataFrame) -> list[tuple[float, str, str]]:
    """Return an event for each spell in which a satellite's loop would not have kept lock."""
    events = []
    for sv, rows in table.groupby("sv", observed=True):
        time = rows["time_s"].to_numpy()
        for loop in LOOPS:
            for begin, end in stretches_of(~rows[f"lock_{loop}"].to_numpy()):
                least = rows[f"reserve_{loop}_db"].to_numpy()[begin:end].min()
                detail = (
                    f"{sv}: {time[end - 1] - time[begin]:.1f} s, {-least:.1f} dB below the threshold at worst"
                )
                events.append((float(time[begin]), f"lock_lost_{loop}", detail))
    return events


def _never_in_sight(path: FlownPath, links: Link, config: InterferenceConfig) -> list[tuple[float, str, str]]:
    never = np.flatnonzero(links.in_sight.max(axis=0) == 0.0)
    nearest_km = links.distance_m.min(axis=0) / 1e3
    return [
        (
            float(path.time_s[0]),
            "emitter_beyond_horizon",
            f"{config.emitter[k].name or f'emitter {k + 1}'}: never nearer than {nearest_km[k]:.1f} km",
        )
        for k in never
    ]
