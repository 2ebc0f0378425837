"""A receiver's measured offsets of replicas that were set by a navigation state: range and range rate, as rows.

    z_r = r + clock,         h_r = [-u in position, 1 in the clock]
    z_v = r' + drift,        h_v = [g in position, -u in velocity, 1 in the drift]
    z_a = r'' + drift',      h_a = [u in the accelerometers' biases], of a receiver without INS alone

truth minus prediction, at an antenna where the IMU is; u towards the satellite, g the derivative of the range rate by
the position. Without INS the bias of an inertial system that feels nothing is minus the vehicle's acceleration.
A carrier phase divided by k is such a range: all phases begin from one position, so that with the
position X^P that they belong to (pseudo-coordinates), phi_i = k (-u_i . X^P + b)            [Shatilov 2007, chapter 2].
Where that position is off by delta, X^P - X = delta holds at the beginning alone: what the phases' ranges are off by
stays -u_i(0) . delta, and once the satellites have moved no position explains it. X^P - X then changes by
H^+(t) (H(0) - H(t)) delta, about delta times the change of direction: 0.6 m in twenty minutes (12 deg) for 5 m, an
error of 0.5 mm/s in the velocity that pseudo-coordinates are for. The millimetre of the print needs a start that is
good to 4 mm. What no position explains stays in the phases: for 5 m it grows by 1 mm/s, so that a loop with data
leaves its aperture after 40 to 90 s, for 0.2 m after 20 minutes. Where each phase begins from a code of its own (50 m),
X^P - X changes by 1 to 2 m in a degree (5 to 12 m where all stand below 30 deg). A satellite that
rises later therefore begins from X^P, which is where the filter's prediction puts its replica, with a state of its own.
With a state N_i of its own, the phase's range is that of the code plus N_i (the method of the additional variable): 1
in N_i. N_i never settles: of a satellite alone its variance is 1 / (1 / P0 + k / (D_code + D_phase)) after k
observations; of m > 4 satellites the m - 4 combinations that no position and clock can explain are known as well as
the phases, so that a share h (H^T H)^-1 h^T of it is left, which sums to 4. The printed 0.02 to 0.04 m are reached by
four hours of code at 40 dBHz and one chip of spacing (95 m in a millisecond)             [Shatilov 2007, chapter 2].
Both observations of a channel may share their errors: C = [[a, b], [b, d]] goes in as two rows without
correlation, z_r with a, then z_v - (b / a) z_r with d - b^2 / a.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.state import BA, CLOCK, DR, DRIFT, DV
from insgnss.geodesy.vectors import place_negative
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

COLUMNS: Final = (DR, DR + 1, DR + 2, CLOCK, DV, DV + 1, DV + 2, DRIFT)
RANGE_COLUMNS: Final = 4  # the first of them: a range has no other
PHASE_COLUMNS: Final = RANGE_COLUMNS + 1  # and those of a phase with a state of its own behind them
ACCELERATION_COLUMNS: Final = (*COLUMNS, BA, BA + 1, BA + 2)
# places in the row of an acceleration, behind those: what all channels share, and the phase's own state
SHARED_COLUMN: Final = len(ACCELERATION_COLUMNS)
OWN_COLUMN: Final = SHARED_COLUMN + 1
_POSITION, _CLOCK, _VELOCITY, _DRIFT = (COLUMNS.index(state) for state in (DR, CLOCK, DV, DRIFT))


@kernel(inline=True)
def offset_range_row(u: Float64, h: Float64) -> None:
    """Write the row of a range, (>= 4,)."""
    place_negative(h, _POSITION, u)
    h[_CLOCK] = 1.0


@kernel(inline=True)
def offset_rate_row(u: Float64, g: Float64, of_range: float, h: Float64) -> None:
    """Write the row of a range rate less ``of_range`` [1/s] times the range, (8,)."""
    for i in range(3):
        h[_POSITION + i] = g[i] + of_range * u[i]
    h[_CLOCK] = -of_range
    place_negative(h, _VELOCITY, u)
    h[_DRIFT] = 1.0


@kernel(inline=True)
def offset_acceleration_row(u: Float64, g: Float64, of_range: float, of_rate: float, h: Float64) -> None:
    """Write the row of an acceleration less ``of_range`` [1/s^2] times the range and ``of_rate`` [1/s] times its rate.

    ``h`` is (>= 11,), in the order of ``ACCELERATION_COLUMNS``.
    """
    for i in range(3):
        h[_POSITION + i] = of_range * u[i] - of_rate * g[i]
        h[_VELOCITY + i] = of_rate * u[i]
        h[len(COLUMNS) + i] = u[i]
    h[_CLOCK] = -of_range
    h[_DRIFT] = -of_rate
