"""What a receiver makes of the signals: their strength at its antennas, which it tracks, the noise of its loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from insgnss.antenna.equipment import mounting
from insgnss.antenna.gain_pattern import GainTable
from insgnss.antenna.obstruction import Obstruction, is_inside, read_obstruction
from insgnss.antenna.pattern_file import read_pattern
from insgnss.config.flight import MountedAntenna
from insgnss.config.library import antenna_file
from insgnss.constants import C_MPS
from insgnss.geodesy.directions import angles_of
from insgnss.simulation.observations import MOST_AMBIGUITY_CYCLES, SignalObservations
from insgnss.tables import LLI_SLIP, Bool, Float64

HIDDEN_DBIC = -60.0  # behind the airframe: below any receiver's threshold


@dataclass(frozen=True)
class ReceivingAntenna:
    """One antenna: its pattern between the nodes of its file, its orientation, its obstructions."""

    gain: RegularGridInterpolator  # of elevation and azimuth [deg], antenna axes
    C_ba: Float64  # (3, 3)
    obstruction: Obstruction | None

    @classmethod
    def mounted(cls, antenna: MountedAntenna, folder: Path) -> ReceivingAntenna:
        """Return the antenna as a flight file describes it; relative paths start at ``folder``.

        Raises
        ------
        ModelError, MissingFileError, ConfigError : no such pattern or file, or a wrong one
        """
        table, _ = read_pattern(antenna_file(antenna.pattern, (folder,)))
        hidden = None if antenna.obstruction is None else read_obstruction(folder / antenna.obstruction)
        return cls(interpolated(table), mounting(antenna), hidden)

    def gain_dbic(self, u_b: Float64) -> Float64:
        """Return the gain towards unit directions (k, 3), body axes."""
        azimuth, elevation = np.degrees(angles_of(u_b @ self.C_ba))  # C_ab u_b
        gain = np.asarray(self.gain(np.column_stack([elevation, azimuth % 360.0])))
        for shape in () if self.obstruction is None else self.obstruction.shapes():
            gain = np.where(is_inside(shape, u_b), HIDDEN_DBIC, gain)
        return gain


def interpolated(table: GainTable) -> RegularGridInterpolator:
    """Return a pattern as a bilinear function of elevation and azimuth (0 to 360) [deg]."""
    azimuth = np.append(table.azimuth_deg, 360.0)
    around = np.column_stack([table.gain_dbic, table.gain_dbic[:, 0]])
    return RegularGridInterpolator((table.elevation_deg, azimuth), around)


@dataclass(frozen=True)
class Reception:
    """A receiver with one antenna or several, the strongest of which counts, and its link budget."""

    antennas: Sequence[ReceivingAntenna]
    cn0_at_0_dbic_dbhz: float = 45.0

    def cn0_dbhz(self, direction_b: Float64) -> Float64:
        """Return C/N0 (m, n) towards unit directions (m, n, 3) to the satellites, body axes."""
        flat = direction_b.reshape(-1, 3)
        gain = np.max([antenna.gain_dbic(flat) for antenna in self.antennas], axis=0)
        return np.asarray(self.cn0_at_0_dbic_dbhz + gain.reshape(direction_b.shape[:2]))


def _ratio(cn0_dbhz: Float64) -> Float64:
    """Return carrier over noise density as a ratio [Hz]; below 10 dBHz, where nothing is tracked, as there."""
    return np.asarray(10.0 ** (0.1 * np.maximum(cn0_dbhz, 10.0)))


@dataclass(frozen=True)
class CodeLoopNoise:
    """A delay lock loop, early minus late power.

    Equation: ``s^2 = B d / (2 C/N0) (1 + 2 / ((2 - d) T C/N0))`` [chips^2]    [Kaplan and Hegarty (2017), 8.4.2]
    """

    bandwidth_hz: float
    spacing_chips: float  # early to late
    integration_s: float
    chip_m: float | Float64  # of all columns, or of each

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma [m]."""
        c, d = _ratio(cn0_dbhz), self.spacing_chips
        squaring = 1.0 + 2.0 / ((2.0 - d) * self.integration_s * c)
        return np.asarray(self.chip_m * np.sqrt(self.bandwidth_hz * d / (2.0 * c) * squaring))


@dataclass(frozen=True)
class CarrierLoopNoise:
    """A Costas loop.

    Equation: ``s^2 = (wavelength / 2 pi)^2 B / C/N0 (1 + 1 / (2 T C/N0))``       [Kaplan and Hegarty (2017), 8.3]
    """

    bandwidth_hz: float
    integration_s: float
    wavelength_m: float | Float64  # of all columns, or of each

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma [m]."""
        c = _ratio(cn0_dbhz)
        squaring = 1.0 + 1.0 / (2.0 * self.integration_s * c)
        return np.asarray(self.wavelength_m / (2.0 * np.pi) * np.sqrt(self.bandwidth_hz / c * squaring))


@dataclass(frozen=True)
class FrequencyLoopNoise:
    """A frequency lock loop, which gives the Doppler.

    Equation: ``s = wavelength / (2 pi T) sqrt(4 B / C/N0 (1 + 1 / (T C/N0)))``   [Kaplan and Hegarty (2017), 8.3]
    """

    bandwidth_hz: float
    integration_s: float
    wavelength_m: float | Float64  # of all columns, or of each

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma [m/s]."""
        c = _ratio(cn0_dbhz)
        jitter = np.sqrt(4.0 * self.bandwidth_hz / c * (1.0 + 1.0 / (self.integration_s * c)))
        return np.asarray(self.wavelength_m / (2.0 * np.pi * self.integration_s) * jitter)


CA_CHIP_M = C_MPS / 1.023e6  # IS-GPS-200N, 3.2.1.3


@dataclass(frozen=True)
class TrackingRules:
    """The least C/N0, the time to find a signal again, and slips of the carrier while it is tracked."""

    threshold_dbhz: float = 28.0
    reacquire_s: float = 2.0
    slips_per_hour: float = 0.0  # of each carrier
    slips_indicated: float = 1.0  # share that the receiver notices

    def apply(
        self, seen: SignalObservations, strength_dbhz: Float64, rng: np.random.Generator | None
    ) -> SignalObservations:
        """Return the observations that the receiver makes of signals of the given mean C/N0 (m, n).

        A signal counts as received from the first epoch if it is strong enough there. Every new beginning brings the
        carrier a new ambiguity, which the indicator marks.
        """
        tracked = self.tracked(seen.tag_s, seen.tracked & (strength_dbhz >= self.threshold_dbhz))
        seen = replace(seen, tracked=tracked)
        if seen.carrier_cycles is None or seen.lli is None or rng is None:
            return seen
        begins = tracked.copy()
        begins[1:] &= ~tracked[:-1]
        begins[0] = False
        first = tracked & (np.cumsum(tracked, axis=0) == 1)
        lost = begins & ~first
        slips, indicated = self._slips(seen.tag_s, tracked, rng)
        size = MOST_AMBIGUITY_CYCLES
        added = np.where(lost, rng.integers(-size, size, lost.shape), slips)
        lli = np.where(lost | indicated, seen.lli | LLI_SLIP, seen.lli).astype(np.int8)
        return replace(seen, carrier_cycles=seen.carrier_cycles + np.cumsum(added, axis=0), lli=lli)

    def tracked(self, tag_s: Float64, received: Bool) -> Bool:
        """Return what is tracked of signals received (m, n): not before ``reacquire_s`` after their return."""
        tracked = received.copy()
        waits_until = np.full(received.shape[1], -np.inf)
        for k in range(1, len(tag_s)):
            returned = received[k] & ~received[k - 1]
            waits_until[returned] = tag_s[k] + self.reacquire_s
            tracked[k] &= tag_s[k] >= waits_until
        return tracked

    def _slips(self, tag_s: Float64, tracked: Bool, rng: np.random.Generator) -> tuple[Float64, Bool]:
        """Return the cycles slipped before each epoch, one to ten up or down, and which ones the receiver notices."""
        step = np.diff(tag_s, prepend=tag_s[:1])[:, None]
        happens = (rng.random(tracked.shape) < self.slips_per_hour * step / 3600.0) & tracked
        cycles = rng.integers(1, 11, tracked.shape) * rng.choice([-1, 1], tracked.shape)
        return np.where(happens, cycles, 0), happens & (rng.random(tracked.shape) < self.slips_indicated)
