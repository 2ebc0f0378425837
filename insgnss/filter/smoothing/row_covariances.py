"""The covariance behind each navigation row of the filter, for outputs beyond the row's own columns.

The loop does not keep it. It goes one epoch at a time here: the row of an epoch is the last one written, its covariance
still in the work space; rows between epochs are made once more from a copy of the filter as the epoch before left it,
or as a user's own rows in between did.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from insgnss.filter.loop import newest_sample, run_to
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.gps_time import covariances_at_gps_time
from insgnss.filter.output.writing import Output, mixture_covariance
from insgnss.filter.own_update import OwnUpdate
from insgnss.filter.prediction import ImuSamples, carry_bank, new_scratch
from insgnss.filter.smoothing.between import filtered
from insgnss.filter.smoothing.body_points import PointColumnValues
from insgnss.filter.state import Bank, copy_bank
from insgnss.gnss.observation_rows import GnssRows, one_epoch
from insgnss.tables import Float64, Int64


def each_epoch(rows: GnssRows, first: int, last: int, out: Output) -> Iterator[tuple[GnssRows, Output]]:
    """Yield the rows of each of some epochs, and the output with room for their ledger alone.

    The filter then keeps only this of an epoch.
    """
    for epoch in range(first, last):
        own = slice(int(rows.first[epoch]), int(rows.first[epoch + 1]))
        carrier = out.carrier[own] if len(out.carrier) else out.carrier
        yield one_epoch(rows, epoch), out._replace(ledger=out.ledger[own], carrier=carrier)


@dataclass
class RowCovariances:
    """Fills the further columns of the rows that a navigator writes."""

    navigator: Navigator
    imu: ImuSamples
    further: PointColumnValues
    _before: Bank | None = None  # the filter at the last epoch, or where it used own rows since
    _parameters: npt.NDArray[Any] = field(init=False)  # its numbers
    _written: int = 0  # navigation rows up to then

    def forward(self, rows: GnssRows, first: int, last: int, out: Output) -> None:
        """Process the epochs ``first`` to ``last - 1``."""
        for alone, written in each_epoch(rows, first, last, out):
            self.run(alone, written)

    def run(self, rows: GnssRows, out: Output) -> None:
        """Process an epoch as ``Navigator.run`` does, and fill what belongs to the rows that it writes."""
        navigator = self.navigator
        work = navigator.workspace(rows)  # a filter that gets further states has another one then
        with self._by_way_of_own_rows(out):
            navigator.run(self.imu, rows, 0, 1, out)
        first, last = self._written, int(out.counts[0].nav)
        if last > first and out.nav["t_ns"][last - 1] == rows.epoch_ns[0]:
            last -= 1
            self._write(slice(last, last + 1), work.P_out[None], out)
        self._write_between(self._before if self._before is not None else navigator.opened, first, last, out)

    def own_to_the_end(self, no_rows: GnssRows, out: Output) -> None:
        """Use a user's own rows after the last epoch, and fill what belongs to the rows up to the last of them."""
        with self._by_way_of_own_rows(out):
            self.navigator.use_own_rows(self.imu, no_rows, int(self.imu.t_ns[-1]), out)

    @contextmanager
    def _by_way_of_own_rows(self, out: Output) -> Iterator[None]:
        """Begin where the filter stands; fill the rows up to each time at which it uses a user's own rows."""
        navigator, others = self.navigator, self.navigator.after_own
        self._begin(navigator.bank, out)

        def go_on(update: OwnUpdate) -> None:
            before = self._before if self._before is not None else navigator.opened
            self._write_between(before, self._written, int(out.counts[0].nav), out)
            self._begin(navigator.bank, out)
            others(update)

        navigator.after_own = go_on
        try:
            yield
        finally:
            navigator.after_own = others

    def _begin(self, bank: Bank | None, out: Output) -> None:
        self._before, self._written = None if bank is None else copy_bank(bank), int(out.counts[0].nav)
        self._parameters = self.navigator.parameters

    def to_the_end(self, bank: Bank, no_rows: GnssRows, out: Output) -> None:
        """Carry the filter's bank to the last sample, and fill what belongs to the rows on the way."""
        self._begin(bank, out)
        navigator, first, before = self.navigator, self._written, self._before
        work = navigator.workspace(no_rows)
        run_to(bank, int(self.imu.t_ns[-1]), self.imu, navigator.parameters, out, work)
        self._write_between(before, first, int(out.counts[0].nav), out)

    def _write_between(self, before: Bank | None, first: int, last: int, out: Output) -> None:
        if before is None or last == first:
            return
        times_ns, parameters = out.nav["t_ns"][first:last].copy(), self._parameters
        if len(before.state) == 1:
            for some, P in filtered(before, times_ns, self.imu, parameters):
                self._write(slice(first + some.start, first + some.stop), P, out)
        else:
            self._write(slice(first, last), self._mixtures(before, times_ns), out)

    def _mixtures(self, bank: Bank, times_ns: Int64) -> Float64:
        """Return the covariances (m, n, n) of a bank of several headings, as its rows have them."""
        n = bank.P.shape[1]
        P, scratch, par = np.zeros((len(times_ns), n, n)), new_scratch(n), self._parameters[0]
        for at, t_ns in enumerate(times_ns):
            carry_bank(bank, newest_sample(bank.head[0], self.imu, t_ns), self.imu, par, scratch)
            mixture_covariance(bank, P[at])
            lead = int(bank.head[0].leader)
            covariances_at_gps_time(bank.state[lead : lead + 1], self._parameters, P[at : at + 1])
        return P

    def _write(self, rows: slice, P: Float64, out: Output) -> None:
        self.further.write(rows, out.nav, P, self.imu, self._parameters[0])
