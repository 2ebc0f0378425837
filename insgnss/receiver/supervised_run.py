"""The supervisor's tables: its decision for every satellite and epoch, each transition, and the time spent in search.

| table           | one row for each | columns |
|-----------------|------------------|---------|
| supervision     | satellite above the horizon and time | time_s sv state decision receiver el_deg gain_dbi sd_gain_db cn0_dbhz pseudorange_m doppler_hz sd_range_m sd_range_rate_mps within_aperture delay_half_width_chips doppler_half_width_hz delay_cells doppler_bins accumulation_s search_s |
| transitions     | change of state  | time_s sv from_state to_state reason pseudorange_m doppler_hz sd_range_m sd_doppler_hz accumulation_s delay_cells doppler_bins search_s |
| search_times    | satellite        | sv predicted_s hold_s control_s search_s in_vain_s unsupervised_s unsupervised_in_vain_s, and with a log of the receiver's events n_events n_agree n_differ n_not_covered receiver_search_s receiver_inhibited_s receiver_needless_s |
| receiver_events | event in the receiver's log | time_s sv event supervisor verdict lag_s |

``sd_range_m`` and ``sd_range_rate_mps`` are sqrt(D), D = h P^- h^T (``predictions``); pseudorange and Doppler are what the
receiver would measure, its clock in. ``receiver`` says whether the receiver's log has a pseudorange. An ``accumulation_s``
or ``search_s`` that is infinite has no allowed accumulation that suffices.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.antenna.visibility import DECISIONS, UNDECIDED
from insgnss.config.search import Search
from insgnss.constants import NS_PER_S
from insgnss.gpstime import ns_to_week_seconds
from insgnss.receiver.events import (
    EVENT_NAMES,
    VERDICT_NAMES,
    EventComparison,
    ReceiverEvents,
    compare_events,
)
from insgnss.receiver.predictions import Outlook
from insgnss.receiver.supervisor import Predictions, Supervision, Totals, Transitions, supervise
from insgnss.receiver.tracking_state import ABSENT, MISSING, NOT_KNOWN, PRESENT, REASON_NAMES, STATE_NAMES
from insgnss.results.table_files import words
from insgnss.tables import Bool, Float64, GnssTable, Int8, Int64

LATE_EPOCHS: Final = 1.5  # usual intervals after which an epoch says nothing any more: one was left out
RECEIVER_NAMES: Final = ("not_known", "missing", "present")  # presence + 1
_GAP_INTERVALS: Final = 5.0  # usual intervals, and
_GAP_S: Final = 2.0  # seconds without a prediction after which none is valid


class Sightings(NamedTuple):
    """The epochs of a receiver's log, and which satellites have a pseudorange in each, on any signal."""

    epoch_ns: Int64  # (k,) increasing
    seen: Bool  # (k, s)
    sv_names: tuple[str, ...]  # (s,)


def sightings_of(gnss: GnssTable) -> Sightings:
    """Return the receiver's sightings; a row without a pseudorange is not a sighting, but its epoch counts."""
    epoch_ns, epoch = np.unique(gnss.t_ns, return_inverse=True)
    seen = np.zeros((len(epoch_ns), len(gnss.sv_names)), np.bool_)
    has_range = np.isfinite(gnss.pseudorange_m)
    seen[epoch[has_range], gnss.sv[has_range]] = True
    return Sightings(epoch_ns, seen, gnss.sv_names)


def presence(
    sightings: Sightings, t_ns: Int64, sv_names: Sequence[str], usual_ns: float | None = None
) -> Int8:
    """Return (n, m) PRESENT or MISSING by the newest epoch not later than each time.

    NOT_KNOWN where there is none, or where it is older than one and a half of the log's usual intervals. A satellite
    that is never in the log is MISSING.

    Parameters
    ----------
    t_ns : (n,) GPS time
    sv_names : names of the m satellites
    usual_ns : the usual interval of the receiver's epochs; that of these epochs if None
    """
    if not len(sightings.epoch_ns):
        return np.full((len(t_ns), len(sv_names)), NOT_KNOWN, np.int8)
    column = {name: i for i, name in enumerate(sightings.sv_names)}
    places = np.array([column.get(name, -1) for name in sv_names], np.int64)
    if usual_ns is None:
        steps = np.diff(sightings.epoch_ns)
        usual_ns = float(np.median(steps)) if len(steps) else 0.0
    newest = np.searchsorted(sightings.epoch_ns, t_ns, side="right") - 1
    known = (newest >= 0) & (t_ns - sightings.epoch_ns[newest] <= LATE_EPOCHS * usual_ns)
    seen = np.zeros((len(t_ns), len(sv_names)), np.bool_)
    logged = np.flatnonzero(places >= 0)
    seen[:, logged] = sightings.seen[np.ix_(np.maximum(newest, 0), places[logged])]
    found = np.where(seen, PRESENT, MISSING)
    return np.where(known[:, None], found, NOT_KNOWN).astype(np.int8)


@dataclass(frozen=True)
class SupervisedRun:
    """The result of ``supervise_run``. Tables are DataFrames, the module's text has their columns."""

    supervision: pd.DataFrame
    transitions: pd.DataFrame
    search_times: pd.DataFrame
    receiver_events: pd.DataFrame | None = None  # None without a log of the receiver's events


def supervise_run(
    view: Outlook,
    sightings: Sightings | None,
    settings: Search,
    week: int,
    receiver_log: ReceiverEvents | None = None,
) -> SupervisedRun:
    """Return a supervised receiver's action for every satellite over a run.

    If the filter gave no prediction for long (a restart), every satellite's prediction ends.

    Parameters
    ----------
    sightings : what the receiver saw; None: nothing is known, a visible signal is there
    week : GPS week that ``time_s`` counts from
    receiver_log : the receiver's own events, to be compared

    Raises
    ------
    ConfigError, TimeError : as ``insgnss.receiver.supervisor.supervise``
    """
    source = rows_and_gaps(view.predicted.t_ns)
    predicted = _with_gaps(view.predicted, source)
    seen = np.full(predicted.decision.shape, NOT_KNOWN, np.int8)
    if sightings is not None:
        seen = presence(sightings, predicted.t_ns, view.sv_names)
    result = supervise(predicted, seen, settings, view.scale)
    times = search_times(view.sv_names, _predicted_s(predicted.t_ns, result), result.totals)
    compared = None
    if receiver_log is not None:
        verdicts = compare_events(receiver_log, predicted.t_ns, result.state, view.sv_names)
        compared = _event_table(verdicts, receiver_log, week)
        times = _with_receiver(times, verdicts)
    return SupervisedRun(
        supervision_table(view, source, result, seen, settings, week),
        transition_table(result.transitions, view.sv_names, week),
        times,
        compared,
    )


def rows_and_gaps(t_ns: Int64) -> Int64:
    """Return the rows of a timeline in order, with -1 after the last one before each gap."""
    steps = np.diff(t_ns)
    rows = np.arange(len(t_ns), dtype=np.int64)
    if not len(steps):
        return rows
    return np.insert(rows, np.flatnonzero(steps > longest_gap_ns(float(np.median(steps)))) + 1, -1)


def longest_gap_ns(usual_ns: float) -> float:
    """Return the longest time for which a satellite keeps its state without a prediction."""
    return max(_GAP_INTERVALS * usual_ns, _GAP_S * NS_PER_S)


def _with_gaps(predicted: Predictions, source: Int64) -> Predictions:
    """Return the predictions with a row of none a usual interval after the last before each gap."""
    gap = np.flatnonzero(source < 0)
    if not len(gap):
        return predicted
    filled = {name: values[source] for name, values in predicted._asdict().items()}
    filled["t_ns"][gap] = filled["t_ns"][gap - 1] + int(np.median(np.diff(predicted.t_ns)))
    filled["decision"][gap] = UNDECIDED
    for name in ("cn0_dbhz", "d_range_m2", "d_rate_m2ps2", "delay_m", "range_rate_mps"):
        filled[name][gap] = np.nan
    return Predictions(**filled)


def supervision_table(
    view: Outlook, source: Int64, result: Supervision, seen: Int8, settings: Search, week: int
) -> pd.DataFrame:
    """Return one row for each satellite and time with a prediction."""
    predicted, window = view.predicted, result.window
    known = (result.state != ABSENT) & (source >= 0)[:, None]
    at = np.nonzero(known)
    row = source[at[0]], at[1]  # in the predictions, which know no gaps
    chip_m, wavelength_m = (np.asarray(s, np.float64)[at[1]] for s in view.scale[:2])
    sigmas = settings.grid.sigmas
    sd_range, sd_rate = np.sqrt(predicted.d_range_m2[row]), np.sqrt(predicted.d_rate_m2ps2[row])
    columns: dict[str, Any] = {
        "time_s": ns_to_week_seconds(predicted.t_ns[row[0]], week),
        "sv": words(at[1], view.sv_names),
        "state": words(result.state[at], STATE_NAMES),
        "decision": words(predicted.decision[row], DECISIONS),
        "receiver": words(seen[at] + 1, RECEIVER_NAMES),
        "el_deg": np.degrees(view.elevation[row]),
        "gain_dbi": view.gain[(*row, 0)],
        "sd_gain_db": view.gain[(*row, 1)],
        "cn0_dbhz": predicted.cn0_dbhz[row],
        "pseudorange_m": predicted.delay_m[row],
        "doppler_hz": -predicted.range_rate_mps[row] / wavelength_m,
        "sd_range_m": sd_range,
        "sd_range_rate_mps": sd_rate,
        "within_aperture": window.within_aperture[at],
        "delay_half_width_chips": sigmas * sd_range / chip_m,
        "doppler_half_width_hz": sigmas * sd_rate / wavelength_m,
        **{
            name: getattr(window, name)[at]
            for name in ("delay_cells", "doppler_bins", "accumulation_s", "search_s")
        },
    }
    return pd.DataFrame(columns)


def transition_table(transitions: Transitions, sv_names: Sequence[str], week: int) -> pd.DataFrame:
    """Return one row for each transition, in the order of time, then of the satellites."""
    t = transitions
    return pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(t.t_ns, week),
            "sv": words(t.sv, sv_names),
            "from_state": words(t.before, STATE_NAMES),
            "to_state": words(t.after, STATE_NAMES),
            "reason": words(t.reason, REASON_NAMES),
            "pseudorange_m": t.delay_m,
            "doppler_hz": t.doppler_hz,
            "sd_range_m": t.sigma_delay_m,
            "sd_doppler_hz": t.sigma_doppler_hz,
            "accumulation_s": t.accumulation_s,
            "delay_cells": t.delay_cells,
            "doppler_bins": t.doppler_bins,
            "search_s": t.search_s,
        }
    )


def search_times(sv_names: Sequence[str], predicted_s: Float64, totals: Totals) -> pd.DataFrame:
    """Return the seconds of each satellite."""
    codes = np.arange(len(sv_names))
    return pd.DataFrame({"sv": words(codes, sv_names), "predicted_s": predicted_s, **totals._asdict()})


def _predicted_s(t_ns: Int64, result: Supervision) -> Float64:
    """Return for how long each satellite was predicted; a state lasts until the next time."""
    known = result.state[:-1] != ABSENT
    spent: Float64 = np.diff(t_ns) / NS_PER_S @ known if len(t_ns) > 1 else np.zeros(known.shape[1])
    return spent


def _with_receiver(times: pd.DataFrame, compared: EventComparison) -> pd.DataFrame:
    """Return the seconds with those that the receiver itself has spent; its satellites that were not predicted too."""
    own = compared.satellites
    counts = ("n_events", "n_agree", "n_differ", "n_not_covered")
    receiver = pd.DataFrame(
        {
            "sv": list(own.sv),
            **dict(zip(counts, own[1:5], strict=True)),
            "receiver_search_s": own.search_s,
            "receiver_inhibited_s": own.inhibited_s,
            "receiver_needless_s": own.needless_s,
        }
    )
    names = [str(name) for name in times["sv"]]
    names += sorted(set(own.sv) - set(names))
    joined = times.astype({"sv": "str"}).merge(receiver, on="sv", how="outer").set_index("sv").loc[names]
    joined = joined.reset_index()
    joined["sv"] = words(np.arange(len(names)), names)
    whole = joined[list(counts)].fillna(0).astype("int64")
    return joined.assign(**{name: whole[name] for name in counts})


def _event_table(compared: EventComparison, log: ReceiverEvents, week: int) -> pd.DataFrame:
    """Return one row for each event of the receiver."""
    verdicts = compared.verdicts
    return pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(verdicts.t_ns, week),
            "sv": words(log.sv, log.sv_names),
            "event": words(log.event, EVENT_NAMES),
            "supervisor": pd.Categorical(
                verdicts.supervisor, categories=pd.Index(list(STATE_NAMES), dtype="str")
            ),
            "verdict": pd.Categorical(
                verdicts.verdict, categories=pd.Index(list(VERDICT_NAMES), dtype="str")
            ),
            "lag_s": verdicts.lag_s,
        }
    )
