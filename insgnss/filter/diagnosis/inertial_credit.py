"""Whether the noise of the inertial sensors still counts as that of their grade, when they keep failing.

A sensor that fails once is found by a look back, and a lost filter is set right by a reset. Inertial samples in a wrong
unit or along wrong axes fail again and again: each remedy ends in the next failure, and between two of them the
attitude is wrong with a small sigma. After the fourth failure within five minutes the filter restarts with the samples'
white noise increased by s times its variance, so that the noise explains the largest of these failures:

    reset by a velocity dv:     s = |dv|^2 / (3 T q_a)
    jump of a sensor's bias db: s = |db|^2 T / (3 q)

with q the density of the grade (q_a: of the accelerometers) and T = 10 s, within which such an error arises. The filter
then follows the satellites, with a wide attitude. After five minutes without a failure it restarts with the grade's
noise. One failure within the next five minutes is enough then, and the wait doubles.

A look back may find the noise at once, where it explains the last minute better than a failed sensor. The filter keeps
it then, or restarts with ten times as much where the samples were not sound long enough before. Every minute it asks
whether the noise of the grade explains the last minute far better again.

A single fault of a sensor is two failures: that a sensor has failed, and which. In a simulated flight of ten minutes
with wrong units, signs or axes (11 cases) the filter was 0.1 to 25 km off at 100 to 1000 sigma again and again; with
this rule only until the fourth failure, 30 to 280 s after the start, and for up to 100 s of a new trial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

from insgnss.constants import NS_PER_S
from insgnss.filter.parameters import Parameters
from insgnss.tables import Event
from insgnss.units import mps_per_sqrt_s_to_mps_per_sqrt_h, rad_per_sqrt_s_to_deg_per_sqrt_h

DISTRUSTED: Final = "imu_distrusted"
TRUSTED: Final = "imu_trusted"
GRADE_NOISE_AGAIN: Final = "the inertial samples of the last minute agree with the noise of their grade again"
DISTRUSTED_RESTART: Final = "the inertial sensors are distrusted"
TRY_AGAIN: Final = "the inertial sensors are tried again with the noise of their grade"
NEVER_NS: Final = 2**63 - 1
_BEARABLE: Final = 3  # failures
_REMEMBERED_S: Final = 300.0
_ARISES_S: Final = 10.0
_LOOK_NS: Final = 60 * NS_PER_S


@dataclass
class InertialCredit:
    """The failures of the inertial sensors, and the noise that has to be assumed because of them."""

    failures: list[tuple[int, float]] = field(default_factory=list)  # time [ns], s
    excess: float = 0.0  # of the white noise, as a share of the grade's variance
    retry_ns: int = NEVER_NS  # when the grade's noise is tried again
    wait_s: float = _REMEMBERED_S  # without a failure until then
    look_ns: int = NEVER_NS  # when it is asked next whether the samples are as good as their grade again

    def copied(self) -> InertialCredit:
        """Return a copy that shares nothing that changes."""
        return replace(self, failures=list(self.failures))

    def is_lost_by_reset(self, t_ns: int, dv2: float, par: Parameters) -> bool:
        """Note a reset that moved the velocity by ``dv2`` [m^2/s^2]; return whether to restart."""
        return self._is_lost(t_ns, dv2 / (3.0 * _ARISES_S * par.accel_density))

    def is_lost_by_jump(self, t_ns: int, db2: float, density: float) -> bool:
        """Note a bias that jumped by ``db2``, squared, of a sensor of this density; return whether to restart."""
        return self._is_lost(t_ns, db2 * _ARISES_S / (3.0 * density))

    def _is_lost(self, t_ns: int, share: float) -> bool:
        recent = [each for each in self.failures if t_ns - each[0] <= _REMEMBERED_S * NS_PER_S]
        self.failures = [*recent, (t_ns, share)]
        most = max(self.excess, *(share for _, share in self.failures))
        if most == 0.0 or (self.excess == 0.0 and len(self.failures) <= _BEARABLE):
            return False
        risen, self.excess = most > self.excess, most
        self.look_later(t_ns)
        self.retry_ns = t_ns + round(self.wait_s * NS_PER_S)
        return risen

    def found_noise(self, t_ns: int, excess: float, from_the_start: bool) -> None:
        """Note that noise of ``excess`` times the grade's variance explains the samples of the last minute.

        That is the noise of errors that are new in each epoch. If the samples were never sound their errors may last:
        for T = 10 s they count as ten times as much.
        """
        self.excess, self.retry_ns = excess * (_ARISES_S if from_the_start else 1.0), NEVER_NS
        self.look_later(t_ns)

    def look_later(self, t_ns: int) -> None:
        """Ask in a minute whether the samples are as good as their grade again."""
        self.look_ns = t_ns + _LOOK_NS

    def trust_again(self, t_ns: int) -> None:
        """Return to the grade's noise, until the next failure if it comes soon."""
        self.failures = [(t_ns, self.excess)] * _BEARABLE
        self.excess, self.retry_ns, self.look_ns = 0.0, NEVER_NS, NEVER_NS

    def try_again(self, t_ns: int) -> None:
        """Do the same although nothing has shown that the samples are sound: the next wait is twice as long."""
        self.trust_again(t_ns)
        self.wait_s *= 2.0

    def event(self, t_ns: int, par: Parameters, found: bool = False) -> Event:
        """Return what the filter assumes from now on, in words: after failures, or as a look back has ``found``."""
        gyro, accel = (math.sqrt((1.0 + self.excess) * q) for q in (par.gyro_density, par.accel_density))
        why = f"{len(self.failures)} resets and suspicions within {_REMEMBERED_S / 60.0:.0f} min"
        until, causes = f"for up to {self.wait_s / 60.0:.0f} min", ""
        if found:
            why = "noise far above that of their grade explains the last minute"
            until = "until the grade's explains the samples again"
            causes = "causes are strong vibration and a grade that is better than the sensor, and "
        detail = (
            f"the inertial samples contradict the satellites: {why}; {until} their noise counts as"
            f" {rad_per_sqrt_s_to_deg_per_sqrt_h(gyro):.3g} deg/sqrt(h) and"
            f" {mps_per_sqrt_s_to_mps_per_sqrt_h(accel):.3g} m/s/sqrt(h); {causes}'insgnss check FLIGHT' looks for"
            " wrong units, signs and axes"
        )
        return Event(t_ns, DISTRUSTED, detail)
