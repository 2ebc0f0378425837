"""The common part of all further sensors' measurements: their readings, their gate, how much a row counts.

The signs are those of ``filter.own_rows.rows``: a row's value is measured minus predicted, its partials are those of
the prediction. With the body turned by psi, C_eb becomes (I + [psi x]) C_eb, so a vector fixed to the body, seen along
a direction a fixed to the Earth, grows by a . (psi x s) = psi . (s x a); one fixed to the Earth, seen along a direction
s of the body, by s . (-psi x v) = psi . (s x v) with s in Earth axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from insgnss.config.sensors import SensorLog
from insgnss.errors import MeasurementError
from insgnss.filter.layout import StateBlock
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.sensors.readings import LiveReadings, Reading, Readings
from insgnss.tables import Float64, Int64

Config = TypeVar("Config", bound=SensorLog)


@dataclass(frozen=True)
class SensorMeasurement(Generic[Config]):
    """A further sensor as a measurement of the filter; each kind defines its rows."""

    config: Config
    readings: Readings | LiveReadings
    carrying: bool = False  # the filter has no other position or velocity

    unit: ClassVar[str] = ""
    hint: ClassVar[str] = ""  # what to look at where its rows are refused
    stepping_state: ClassVar[str] = ""  # which of its own states may step
    together: ClassVar[bool] = True  # one component out of its gate refuses the whole reading

    @property
    def name(self) -> str:
        """Its kind in the ledger: the sensor's name."""
        return self.config.label

    @property
    def times_ns(self) -> Int64:
        """Times of the readings that are known beforehand [ns]."""
        return self.readings.times_ns

    @property
    def clock(self) -> str:
        """Whose time its tags are: "gps" or "imu"."""
        return self.config.clock

    @property
    def tells_heading(self) -> bool:
        """Whether it measures or decides the heading, which is then checked against the motion."""
        return False

    @property
    def steps(self) -> str:
        """Name of its state whose value may step; empty: none."""
        return f"{self.name}_{self.stepping_state}" if self.stepping_state else ""

    @property
    def live(self) -> bool:
        """Whether readings come in one by one."""
        return isinstance(self.readings, LiveReadings)

    @property
    def gate_sigma(self) -> float:
        """Beyond so many sigmas of its innovation a row is refused."""
        return self.config.gate_sigma

    def live_reading(self, values: npt.ArrayLike, sigma: npt.ArrayLike | None) -> tuple[Float64, Float64]:
        """Return values and sigmas (k,) of a reading that comes live, NaN where there is none.

        Raises
        ------
        MeasurementError : their number is not that of the kind
        """
        given = np.atleast_1d(np.asarray(values, np.float64))
        stated = np.full(self.n_sigmas, np.nan)
        if sigma is not None:
            stated = np.atleast_1d(np.asarray(sigma, np.float64))
        wanted = len(self.config.value_columns)
        if given.shape != (wanted,) or stated.shape != (self.n_sigmas,):
            message = f"a reading of '{self.name}' has {given.size} value(s) and {stated.size} sigma(s)"
            raise MeasurementError(message, advice=f"give {wanted} and {self.n_sigmas}")
        return given, np.where(stated > 0.0, stated, np.nan)

    def take(self, t_ns: int, values: Float64, sigma: Float64) -> bool:
        """Take a reading that comes live; return whether it is used."""
        return isinstance(self.readings, LiveReadings) and self.readings.add(t_ns, values, sigma)

    @property
    def n_sigmas(self) -> int:
        """How many sigmas a reading may have."""
        return len(self.config.sigma_columns)

    def repeats(self, t_ns: int) -> bool:
        """Return whether the reading of a time equals the one before to the bit."""
        return self.readings.is_repeat(t_ns)

    def states(self) -> tuple[StateBlock, ...]:
        """Return the sensor's errors that stay, as states of the filter."""
        return ()

    def rows(self, state: StateEstimate, layout: StateLayout) -> Sequence[Row]:
        """Return the rows of the reading at ``state.t_ns``."""
        return self.rows_of(self.readings.at(state.t_ns), state)

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the rows of a reading."""
        raise NotImplementedError

    def value_of(self, state: StateEstimate, name: str) -> float:
        """Return the estimate of one of the sensor's own scalar states."""
        return float(state.optional[f"{self.name}_{name}"])


def weighted(innovation: float, partials: Mapping[str, npt.ArrayLike], sigma: float, reading: Reading) -> Row:
    """Return a row of a reading: gated with the sigma of one reading, used with its weight among the others."""
    return Row(float(innovation), partials, reading.weight * sigma**2, sigma**2)


def sigma_or(stated: Float64, given: Sequence[float]) -> Float64:
    """Return the log's own sigmas, those of the settings where it has none."""
    return np.where(np.isfinite(stated), stated, given)
