"""Precise orbits (SP3-c, SP3-d), clocks (SP3, RINEX clock) and satellite antennas (ANTEX), read through ``sidereon``.

Several files become one set of products: days are joined, a node that two files have is taken from the first, and an
event states how far the other was off. A satellite of a RINEX clock file takes its clock from such files alone, since
two sources have two time references. Time systems become GPS time; GLO in SP3 has the hours of UTC (SP3-d, line 13).
A node with the flag of a manoeuvre or a clock event is left out with its neighbours, so that nothing is interpolated
across it.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from insgnss.constants import C_MPS, NS_PER_S, S_PER_DAY
from insgnss.errors import InputError, NavigationDataError, TimeError
from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.gnss.orbits.precise import CLOCK_PAIRS, WIDEST_STEP_NS
from insgnss.gnss.phase_centre import SatelliteAntennas
from insgnss.gnss.signals import signal_of
from insgnss.gpstime import BDT_MINUS_GPST_S, datetime_to_ns, leap_seconds, ns_to_datetime
from insgnss.log.events import counted, first_events
from insgnss.log.files import file_text
from insgnss.log.rinex.states import NO_DATE
from insgnss.tables import Event, Float64, Int64, PreciseProducts

_GPS_START_JD: Final = 2_444_244.5
_TAI_MINUS_GPST_S: Final = 19
_LATEST_NS: Final = np.iinfo(np.int64).max
_NUMBER: Final = r"[ ]*-?\d+\.\d*[ ]*"
_POSITION: Final = re.compile(rf"P[A-Z ][ \d]\d(?=.{{42}}){_NUMBER}")
_EPOCH: Final = re.compile(r"\*  \d{4} [ \d]\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d\.\d+")
# Frequencies of the pair in ANTEX; BeiDou's B1I was C01 before the names of RINEX 3.03
_ANTEX_PAIRS: Final = {
    **{"G": (("G01", "G02"),), "R": (("R01", "R02"),), "E": (("E01", "E05"),)},
    **{"C": (("C02", "C06"), ("C01", "C06")), "J": (("J01", "J02"),), "I": (("I05", "I09"),)},
}

_Nodes = dict[int, Any]  # time [ns] -> value


@dataclass
class _ProductContents:
    """The content of the files so far: per satellite its nodes."""

    orbit: dict[str, _Nodes] = field(default_factory=dict)  # values (3,) [m]
    sp3_clock: dict[str, _Nodes] = field(default_factory=dict)  # [s]
    clock: dict[str, _Nodes] = field(default_factory=dict)  # [s]
    events: list[Event] = field(default_factory=list)


def read_precise(paths: Sequence[Path], *, use_predicted: bool = True) -> tuple[PreciseProducts, list[Event]]:
    """Read SP3 and RINEX clock files, in any order and mixture, and join them.

    Parameters
    ----------
    paths : the files, gzipped or not
    use_predicted : whether orbits and clocks that SP3 marks as predicted count (0.05 m and 1 to 5 ns after hours)

    Raises
    ------
    MissingFileError : no such file
    NavigationDataError : a file is of another kind or cannot be read, or there is no orbit or no clock in any
    TimeError : a time system that is not known
    """
    contents = _ProductContents()
    for path in paths:
        text = file_text(path)
        if text[:2] in ("#c", "#d", "#a", "#b"):
            _collect_sp3(text, path, contents, use_predicted)
        elif "RINEX VERSION / TYPE" in text[:400] and "C" in text[20:42]:
            _collect_clocks(text, path, contents)
        else:
            raise NavigationDataError(
                "this is neither an SP3 file nor a RINEX clock file",
                file=path,
                advice="SP3 begins with '#c' or '#d', a RINEX clock file with its version and 'C'",
            )
    names = ", ".join(str(path) for path in paths)
    clocks = contents.sp3_clock | contents.clock
    for kind, nodes in (("orbit", contents.orbit), ("clock", clocks)):
        if not any(nodes.values()):
            raise NavigationDataError(
                f"no usable {kind}", file=names, advice="give SP3 files of the flight's day"
            )
    return _products(contents.orbit, clocks), contents.events


def _products(orbit: dict[str, _Nodes], clocks: dict[str, _Nodes]) -> PreciseProducts:
    """Return the nodes as tables on common times, NaN where a satellite has none."""
    names = tuple(sorted(set(orbit) | set(clocks)))
    orbit_ns, clock_ns = _times(orbit), _times(clocks)
    r_e = np.full((len(names), len(orbit_ns), 3), np.nan)
    clock_s = np.full((len(names), len(clock_ns)), np.nan)
    for s, name in enumerate(names):
        for table, times, nodes in ((r_e, orbit_ns, orbit.get(name)), (clock_s, clock_ns, clocks.get(name))):
            if nodes:
                table[s, np.searchsorted(times, list(nodes))] = list(nodes.values())
    return PreciseProducts(names, orbit_ns, r_e, clock_ns, clock_s)


def _times(nodes: dict[str, _Nodes]) -> Int64:
    return np.array(sorted({t for of_one in nodes.values() for t in of_one}), np.int64)


# ------------------------------------------------------------------------------------------------------------- SP3


def _collect_sp3(text: str, path: Path, contents: _ProductContents, use_predicted: bool) -> None:
    product = _parsed_sp3(text, path, contents)
    times = [_gps_ns(instant, path) for instant in product.epoch_instants]
    declared = product.declared_epoch_count
    if declared is not None and declared > len(times):
        detail = f"{path}: {len(times)} of {declared} epochs: the file is cut short"
        contents.events.append(Event(times[-1] if times else None, "precise_cut", detail))
    orbit: dict[str, _Nodes] = {}
    clock: dict[str, _Nodes] = {}
    flagged: list[tuple[dict[str, _Nodes], str, int]] = []
    predicted: list[int] = []
    undated = "epoch(s) at dates outside GPS time; left out"
    contents.events += counted("precise_damaged", times.count(NO_DATE), undated, path)
    for k, t_ns in enumerate(times):
        if t_ns == NO_DATE:
            continue
        for name, r_e, clock_s, flags in _records(product, k):
            if flags.orbit_predicted or flags.clock_predicted:
                predicted.append(t_ns)
            if r_e is not None and (use_predicted or not flags.orbit_predicted):
                orbit.setdefault(name, {})[t_ns] = r_e
            if clock_s is not None and (use_predicted or not flags.clock_predicted):
                clock.setdefault(name, {})[t_ns] = clock_s
            flagged += [(orbit, name, t_ns)] * flags.maneuver + [(clock, name, t_ns)] * flags.clock_event
    if predicted:
        used = "used" if use_predicted else "left out"
        detail = f"{path}: predicted values {used} from here on ({len(predicted)} records)"
        contents.events.append(Event(min(predicted), "precise_predicted", detail))
    _leave_out_flagged(flagged, path, contents)
    _merge(contents.orbit, orbit, 1.0, path, "orbit", contents)
    _merge(contents.sp3_clock, clock, C_MPS, path, "clock", contents)


@dataclass(frozen=True)
class _Flags:
    """The flags of a clock whose orbit is missing: the library gives none."""

    orbit_predicted: bool = False
    clock_predicted: bool = False
    maneuver: bool = False
    clock_event: bool = False


def _records(product: Any, epoch: int) -> Iterable[tuple[str, Float64 | None, float | None, Any]]:
    """Yield satellite, position [m] or None, clock [s] or None, and flags of one epoch."""
    clocks_alone = product.clock_records_at(epoch)
    for name in product.satellites:
        try:
            state = product.state(name, epoch)
        except KeyError:
            if name in clocks_alone:
                yield name, None, clocks_alone[name].clock_s, _Flags()
            continue
        yield name, np.asarray(state.position_m, dtype=np.float64), state.clock_s, state


def _parsed_sp3(text: str, path: Path, contents: _ProductContents) -> Any:
    """Return the parsed product; where lines are damaged, that of the others."""
    try:
        return sidereon.load_sp3(text.encode())
    except (sidereon.SidereonError, ValueError):
        sound, damaged = _sound_sp3(text)
    try:
        product = sidereon.load_sp3(sound.encode())
    except (sidereon.SidereonError, ValueError) as error:
        raise NavigationDataError(
            f"the SP3 file cannot be read: {error}",
            file=path,
            advice="SP3-c and SP3-d are read; older versions (#a, #b) have to be converted",
        ) from error
    details = (f"{path}:{line}: not readable; left out" for line in damaged)
    contents.events += first_events("precise_damaged", details, path, "left out")
    return product


def _sound_sp3(text: str) -> tuple[str, list[int]]:
    """Return the text without damaged epochs and records, and the numbers of the lines left out."""
    sound_lines: list[str] = []
    damaged: list[int] = []
    epoch_is_sound = True
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("*"):
            epoch_is_sound = _EPOCH.match(line) is not None
        sound = epoch_is_sound and (not line.startswith("P") or _is_position(line))
        sound &= not line.startswith(("V", "E")) or line.startswith("EOF") or len(line) >= 60
        if sound:
            sound_lines.append(line)
        else:
            damaged.append(number)
    return "\n".join(sound_lines) + "\n", damaged


def _is_position(line: str) -> bool:
    """Return whether a record has its satellite, three coordinates and a clock that read as numbers."""
    if _POSITION.match(line) is None:
        return False
    try:
        values = [float(line[at : at + 14]) for at in (4, 18, 32, 46)]
    except ValueError:
        return False
    return bool(np.isfinite(values).all())


def _leave_out_flagged(
    flagged: list[tuple[dict[str, _Nodes], str, int]], path: Path, contents: _ProductContents
) -> None:
    """Remove the flagged nodes and those around them, so that the gap is too wide to be bridged."""
    for nodes, name, t_ns in flagged:
        of_one = nodes.get(name, {})
        for t in [t for t in of_one if 2 * abs(t - t_ns) <= WIDEST_STEP_NS]:
            del of_one[t]
        detail = f"{path}: {name}: manoeuvre or clock event; 11 min before and after are left out"
        contents.events.append(Event(t_ns, "precise_flagged", detail))


def _merge(
    into: dict[str, _Nodes],
    new: dict[str, _Nodes],
    metres: float,
    path: Path,
    what: str,
    contents: _ProductContents,
) -> None:
    """Add nodes that are not there yet; report how many were, and how far off the new ones are."""
    repeated, farthest_m = [], 0.0
    for name, nodes in new.items():
        known = into.setdefault(name, {})
        for t_ns in nodes.keys() & known.keys():
            repeated.append(t_ns)
            farthest_m = max(farthest_m, metres * float(np.max(np.abs(nodes[t_ns] - known[t_ns]))))
        into[name] = nodes | known
    if repeated:
        detail = (
            f"{path}: {len(repeated)} {what} node(s) are in an earlier file too, up to {farthest_m:.3f} m apart; "
            "the earlier file is used"
        )
        contents.events.append(Event(min(repeated), "precise_overlap", detail))


# ---------------------------------------------------------------------------------------------------- RINEX clock


def _collect_clocks(text: str, path: Path, contents: _ProductContents) -> None:
    try:
        product = sidereon.parse_rinex_clock_lossy(text)
    except (sidereon.SidereonError, ValueError) as error:
        raise NavigationDataError(f"the clock file cannot be read: {error}", file=path) from error
    if product.diagnostic_count:
        first = product.diagnostics[0]
        detail = f"{path}:{first.line}: {product.diagnostic_count} line(s) not readable; left out"
        contents.events.append(Event(None, "precise_damaged", detail))
    clock: dict[str, _Nodes] = {}
    for series in product.series:
        if np.all(series.gps_seconds_valid):
            # a float of GPS seconds resolves 0.1 us
            t_ns = np.rint(series.gps_seconds * 1e6).astype(np.int64) * 1000
        else:
            t_ns = np.array([_gps_ns(epoch, path) for epoch in series.epochs], np.int64)
        finite = np.isfinite(series.bias_s) & (t_ns >= 0)
        clock[series.satellite] = dict(
            zip(t_ns[finite].tolist(), series.bias_s[finite].tolist(), strict=True)
        )
    _merge(contents.clock, clock, C_MPS, path, "clock", contents)


def _gps_ns(instant: Any, path: Path) -> int:
    """Return an epoch of any time system as GPS time [ns], ``NO_DATE`` for the year 1 and its like."""
    whole_s = round((float(instant.jd_whole) - _GPS_START_JD) * S_PER_DAY)
    if not 0 <= whole_s <= _LATEST_NS // NS_PER_S:
        return NO_DATE
    t_ns = whole_s * NS_PER_S + round(float(instant.fraction) * S_PER_DAY * NS_PER_S)
    scale = sidereon.TimeScale
    if instant.scale in (scale.UTC, scale.GLONASST):
        return t_ns + leap_seconds(ns_to_datetime(t_ns)) * NS_PER_S
    if instant.scale in (scale.GPST, scale.QZSST, scale.GST):
        return t_ns
    if instant.scale not in (scale.BDT, scale.TAI):
        raise TimeError(f"unsupported time system {instant.scale}", file=path)
    ahead_s = BDT_MINUS_GPST_S if instant.scale == scale.BDT else _TAI_MINUS_GPST_S
    return t_ns - ahead_s * NS_PER_S


# ---------------------------------------------------------------------------------------------------------- ANTEX


def read_antennas(path: Path) -> tuple[SatelliteAntennas, list[Event]]:
    """Read the satellites' phase-centre offsets from an ANTEX file, each for its span of time.

    Raises
    ------
    MissingFileError : no such file
    InputError : no ANTEX file, or one without a satellite
    """
    try:
        blocks = sidereon.load_antex(file_text(path).encode()).antenna_blocks
    except (sidereon.SidereonError, ValueError) as error:
        raise InputError(f"the ANTEX file cannot be read: {error}", file=path) from error
    rows: list[tuple[str, int, int, Float64]] = []
    without: list[str] = []
    events: list[Event] = []
    for block in blocks:
        name = (block.serial or "").strip()
        if name[:1] not in _ANTEX_PAIRS or not re.fullmatch(r"[A-Z]\d\d", name):
            continue
        try:
            offset = _pair_offset(block, name[0])
            first_ns, last_ns = _date_ns(block.valid_from, 0), _date_ns(block.valid_until, _LATEST_NS)
        except (sidereon.SidereonError, ValueError) as error:
            events.append(Event(None, "antenna_not_used", f"{path}: {name}: {error}"))
            continue
        if offset is None:
            without.append(name)
        else:
            rows.append((name, first_ns, last_ns, offset))
    if not rows:
        raise InputError(
            "no satellite antenna in the file", file=path, advice="give igs20.atx or a similar file"
        )
    what = f"antenna(s) without the pair of frequencies: {', '.join(without[:10])}"
    events += counted("antenna_not_used", len(without), what, path)
    names, first, last, offsets = zip(*rows, strict=True)
    antennas = SatelliteAntennas(
        names, np.array(first, np.int64), np.array(last, np.int64), np.stack(offsets)
    )
    return antennas, events


def _pair_offset(block: Any, system: str) -> Float64 | None:
    """Return the offset of the ionosphere-free combination, body x, y, z [m], None where a frequency is missing."""
    one, two = (signal_of(system, code) for code in CLOCK_PAIRS[system])
    for pair in _ANTEX_PAIRS[system]:
        if one is not None and two is not None and set(pair) <= set(block.frequencies):
            # g1 x1 - (g1 - 1) x2, g1 = f1^2 / (f1^2 - f2^2)
            g1 = one.carrier_hz**2 / (one.carrier_hz**2 - two.carrier_hz**2)
            first, second = (np.asarray(block.pco(label), dtype=np.float64) for label in pair)
            return np.asarray(g1 * first - (g1 - 1.0) * second)
    return None


def _date_ns(date: Any, missing: int) -> int:
    """Return a date of ANTEX as GPS time [ns]; its times are GPS's as far as the format says."""
    if date is None:
        return missing
    midnight = dt.datetime(int(date.year), int(date.month), int(date.day))
    of_day_s = int(date.hour) * 3600 + int(date.minute) * 60 + int(date.second)
    return min(max(datetime_to_ns(midnight) + of_day_s * NS_PER_S, 0), _LATEST_NS)
