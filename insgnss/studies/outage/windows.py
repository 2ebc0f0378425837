"""When an outage study takes measurements away, and which: windows given, periodic, at random, or while banking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.filter.antennas.phase_log import KIND as ATTITUDE_DIFFERENCE
from insgnss.filter.antennas.phase_log import PhaseLog, new_ledger
from insgnss.gnss.antenna_phases import epoch_of
from insgnss.gnss.observation_rows import ABSENT, CARRIER, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.status import SWITCHED_OFF, USED
from insgnss.tables import Bool, GnssTable, stretches_of

KIND_NUMBERS: Final = {"pseudorange": PSEUDORANGE, "range_rate": RANGE_RATE, "carrier_difference": CARRIER}
KINDS: Final = (*KIND_NUMBERS, ATTITUDE_DIFFERENCE)


class OutageWindow(NamedTuple):
    """A window in which measurements are removed: from_s <= t < until_s, seconds of the week."""

    from_s: float
    until_s: float


@dataclass(frozen=True)
class Removal:
    """The measurements to remove: all if nothing is named; all named conditions must hold together.

    Whole satellites are taken out of the log as if the receiver had not had them. Of kinds the log keeps its values and
    the filter is set not to use them.
    """

    satellites: tuple[str, ...] = ()
    constellations: tuple[str, ...] = ()  # their letters
    kinds: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        unknown = sorted(set(self.kinds) - set(KINDS))
        if unknown:
            advice = f"give one of {', '.join(KINDS)}"
            raise ConfigError(f"unknown kind of measurement {unknown[0]!r}", key="kinds", advice=advice)

    def rows_of(self, gnss: GnssTable) -> Bool:
        """Return which rows of a log are of the named satellites.

        Raises
        ------
        ConfigError : the log has no such satellite or constellation
        """
        for name in (*self.satellites, *self.constellations):
            if not any(sv.startswith(name) for sv in gnss.sv_names):
                raise ConfigError(
                    f"the log has no {name}",
                    key="satellites" if name in self.satellites else "constellations",
                    advice=f"it has {', '.join(sorted(gnss.sv_names))}",
                )
        return self.chosen(gnss.sv_names)[gnss.sv]

    def chosen(self, sv_names: Sequence[str]) -> Bool:
        """Return which of the given satellites are removed."""
        return np.array(
            [
                (not self.satellites or sv in self.satellites)
                and (not self.constellations or sv[0] in self.constellations)
                for sv in sv_names
            ],
            np.bool_,
        )

    def in_words(self) -> str:
        """Return the removed measurements in words."""
        what = " and ".join(kind.replace("_", " ") for kind in self.kinds) or "all measurements"
        whose = ", ".join(self.satellites) or ", ".join(self.constellations) or "all satellites"
        return f"{what} of {whose}"


ALL_MEASUREMENTS: Final = Removal()


def further_without(
    further: Sequence[GnssTable], main: GnssTable, removal: Removal, from_ns: int, until_ns: int
) -> tuple[list[GnssTable], int]:
    """Return further antennas' logs after an outage of the ``main`` log, and the number of rows removed.

    A row goes with its main epoch.
    """
    mains_ns = np.unique(main.t_ns)
    left = []
    for table in further:
        nearest = epoch_of(table.t_ns, mains_ns)
        t_ns = np.where(nearest < len(mains_ns), np.append(mains_ns, 0)[nearest], table.t_ns)
        within = (t_ns >= from_ns) & (t_ns < until_ns)
        left.append(table.take(np.flatnonzero(~(removal.chosen(table.sv_names)[table.sv] & within))))
    return left, sum(len(table.t_ns) for table in further) - sum(len(table.t_ns) for table in left)


def switched_off(log: PhaseLog, removal: Removal, from_ns: int, until_ns: int) -> tuple[PhaseLog, int]:
    """Return the phases of several antennas with those of the chosen satellites not to be used within an outage.

    The second value counts those of further antennas.
    """
    phases, status = log.phases, log.phases.status.copy()
    epoch = np.repeat(phases.epoch_ns, np.diff(phases.first))
    t_ns = np.concatenate([epoch, phases.t_ns[len(epoch) :]])
    chosen = removal.chosen([sv for sv, _ in phases.names])[phases.channel]
    off = chosen & (t_ns >= from_ns) & (t_ns < until_ns) & (status == USED)
    status[off] = SWITCHED_OFF
    changed = replace(phases, status=status)
    return PhaseLog(changed, new_ledger(changed)), int(np.count_nonzero(off & (phases.antenna > 0)))


def switch_off(rows: GnssRows, kinds: Sequence[str], chosen: Bool, from_ns: int, until_ns: int) -> None:
    """Mark, in place, some kinds of the ``chosen`` rows (n,) within an outage as not to be used."""
    t_ns = np.repeat(rows.epoch_ns, np.diff(rows.first))
    off = chosen & (t_ns >= from_ns) & (t_ns < until_ns)
    for kind in kinds:
        if kind == ATTITUDE_DIFFERENCE:
            continue
        if kind != "carrier_difference":
            status = rows.observation["status"][:, KIND_NUMBERS[kind]]
        elif len(rows.carrier):
            status = rows.carrier["status"]
        else:
            continue
        status[off & (status == USED) & (status != ABSENT)] = SWITCHED_OFF


def periodic_windows(
    first_s: float, until_s: float, *, length_s: float, every_s: float
) -> list[OutageWindow]:
    """Return windows of a length, one each period, that end before ``until_s``.

    Raises
    ------
    ConfigError : a length or period that is none
    """
    require_seconds(length_s=length_s, every_s=every_s)
    count = max(int(np.floor((until_s - length_s - first_s) / every_s + 1e-9)) + 1, 0)
    return [OutageWindow(first_s + k * every_s, first_s + k * every_s + length_s) for k in range(count)]


def random_windows(
    first_s: float, until_s: float, *, length_s: float, count: int, rng: np.random.Generator
) -> list[OutageWindow]:
    """Return windows at random that do not overlap, in the order of time.

    Raises
    ------
    ConfigError : they do not fit
    """
    require_seconds(length_s=length_s)
    require_count(count)
    room = until_s - first_s - count * length_s
    if room < 0.0:
        raise ConfigError(
            f"{count} windows of {length_s:g} s do not fit between {first_s:g} and {until_s:g} s",
            key="random",
            advice="fewer or shorter ones",
        )
    # gaps before each are ordered points of the free time: every placing is as likely as any other
    free = np.sort(rng.uniform(0.0, room, count))
    starts = first_s + free + length_s * np.arange(count)
    return [OutageWindow(float(start), float(start) + length_s) for start in starts]


def banked_windows(nav: pd.DataFrame, bank_deg: float) -> list[OutageWindow]:
    """Return the times in which the roll of a solution is beyond an angle, to either side.

    Raises
    ------
    ConfigError : it never is
    """
    t_s, beyond = nav["time_s"].to_numpy(), (nav["roll_deg"].abs() > bank_deg).to_numpy()
    step = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
    windows = [OutageWindow(float(t_s[a]), float(t_s[b - 1]) + step) for a, b in stretches_of(beyond)]
    if not windows:
        raise ConfigError(
            f"the bank is never beyond {bank_deg:g} deg",
            key="bank_deg",
            advice=f"the largest is {nav['roll_deg'].abs().max():.1f} deg",
        )
    return windows


def window_ns(window: OutageWindow, week_ns: int) -> tuple[int, int]:
    """Return the GPS times of a window's ends."""
    return week_ns + round(window.from_s * NS_PER_S), week_ns + round(window.until_s * NS_PER_S)


def checked(windows: Sequence[tuple[float, float]]) -> list[OutageWindow]:
    """Return given windows.

    Raises
    ------
    ConfigError : one ends before it begins, or is not finite
    """
    for a, b in windows:
        if not (np.isfinite(a) and np.isfinite(b) and a < b):
            raise ConfigError(f"{a:g} to {b:g} s is not a window", key="windows", advice="from before until")
    return [OutageWindow(float(a), float(b)) for a, b in windows]


def require_seconds(**named: float) -> None:
    """Refuse times that are not finite and above zero.

    Raises
    ------
    ConfigError : names the first one
    """
    for key, value in named.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ConfigError(f"invalid time {value} s", key=key, advice="give seconds, above 0")


def require_count(count: int) -> None:
    """Refuse a number of windows that is none.

    Raises
    ------
    ConfigError : it is below one
    """
    if count < 1:
        raise ConfigError(f"{count} windows are none", key="random", advice="give 1 or more")
