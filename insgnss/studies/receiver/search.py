"""Channels that have lost their signal and look for it again: where the filter expects it, as the supervisor does.

The filter's D = h P h^T of delay and rate is the window. Where it lies within the loops' aperture they are closed at
the predicted place at once, else the cells of the window are looked through first (``receiver.search_window``). A
signal is looked for from the block of integrations on in which it is back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insgnss.config.search import Search
from insgnss.constants import C_MPS
from insgnss.filter.rows.replica_offset import COLUMNS
from insgnss.filter.update.replica_offsets import offset_covariance
from insgnss.receiver.detection import detector
from insgnss.receiver.search_window import SignalScale, search_window
from insgnss.studies.receiver.antennas import AttitudeMask, ReceiverMasking
from insgnss.studies.receiver.workspace import NO_SIGNAL, ChannelRoom, FilterRoom
from insgnss.tables import Bool, Float64, Int64
from insgnss.tracking.vector_loop import ChannelConstants


class SearchRow(NamedTuple):
    """One search of one channel."""

    channel: int
    lost_s: float  # since when it had no signal
    back_s: float  # when the signal was back; inf: not until the run's end, and no window was set
    tracked_s: float  # when the loops are closed again; inf: the signal is too weak to be found
    cn0_dbhz_back: float  # that the receiver believes in then
    sd_delay_m: float
    off_m: float  # true offset from where the filter expects it
    sd_rate_mps: float
    off_mps: float
    within_aperture: bool
    cells: float  # delay cells times Doppler bins


class Searches:
    """The channels' search over a run."""

    def __init__(
        self,
        channels: ChannelConstants,
        carrier_hz: float,
        count: int,
        masking: ReceiverMasking | None = None,
    ) -> None:
        self.settings = Search()
        self.need = detector(self.settings.detection)
        self.scale = SignalScale(channels.chip_m, C_MPS / carrier_hz, self.settings.grid.code_chips)
        self.lost_s = np.full(count, np.inf)  # inf: the channel has its signal
        self.tracked_s = np.zeros(count)  # inf: the last search has failed
        self.rows: list[SearchRow] = []
        self._mask = None if masking is None else AttitudeMask(masking, count)

    def told(
        self, level: Int64, cn0_dbhz: Float64, t_s: float, f: FilterRoom, room: ChannelRoom, off: Float64
    ) -> Int64:
        """Return the levels (n, m) of a block that the channels track; the others are without a signal.

        Parameters
        ----------
        level : (n, m) of the signals, ``NO_SIGNAL`` where none is, or too weak a one
        cn0_dbhz : (m,) that the receiver believes in at the block's begin
        t_s : of the block's begin
        off : (m, 2) true offsets from the filter's prediction, at the block's begin
        """
        if self._mask is not None and t_s > 0.0:
            level = np.where(self._mask.hidden(f, room.u), NO_SIGNAL, level)
        for c in range(level.shape[1]):
            gone = level[0, c] == NO_SIGNAL
            if gone and not np.isfinite(self.lost_s[c]):
                self.lost_s[c] = t_s
            if not gone and np.isfinite(self.lost_s[c]):
                row = self._search(c, float(cn0_dbhz[c]), t_s, f, room, off[c])
                # a signal that is too weak to be found is looked for again in the next block, and told once
                if np.isfinite(row.tracked_s) or np.isfinite(self.tracked_s[c]):
                    self.rows.append(row)
                self.tracked_s[c] = row.tracked_s
                if np.isfinite(row.tracked_s):
                    self.lost_s[c] = np.inf
        searching: Bool = self.tracked_s > t_s
        return np.where(searching, NO_SIGNAL, level)

    def all_rows(self) -> tuple[SearchRow, ...]:
        """Return the searches of the whole run, and behind them the channels that have no signal at its end."""
        # a search that has failed has its row
        gone = np.isfinite(self.lost_s) & np.isfinite(self.tracked_s)
        nothing = (np.nan,) * 5
        never = [
            SearchRow(int(c), float(self.lost_s[c]), np.inf, np.inf, *nothing, False, np.nan)
            for c in np.flatnonzero(gone)
        ]
        return (*self.rows, *never)

    def _search(
        self, c: int, cn0_dbhz: float, t_s: float, f: FilterRoom, room: ChannelRoom, off: Float64
    ) -> SearchRow:
        # the window is that of the code: a phase's own state does not count
        columns = f.columns[: len(COLUMNS)]
        d_range, _, d_rate = offset_covariance(f.P, columns, room.u[c], room.g[c], f.h, f.v)
        window = search_window(cn0_dbhz, d_range, d_rate, self.settings, self.need, self.scale)
        within = bool(window.within_aperture)
        waits_s = 0.0 if within else float(window.search_s)
        return SearchRow(
            c,
            float(self.lost_s[c]),
            t_s,
            t_s + waits_s,
            cn0_dbhz,
            float(np.sqrt(d_range)),
            float(off[0]),
            float(np.sqrt(d_rate)),
            float(off[1]),
            within,
            float(window.delay_cells * window.doppler_bins),
        )
