"""Where the errors of the navigation filter stand: the only place of these indices. Error = estimate minus truth.

The first nine are the navigation errors, which the motion couples. Behind them come states of first order, each with a
decay of its own: the biases, the receiver clock, and whatever else a filter estimates (``filter.layout``).
"""

from __future__ import annotations

from typing import Final

DR: Final = 0  # position, ECEF [m]
DV: Final = 3  # velocity, ECEF [m/s]
PSI: Final = 6  # attitude, C_eb_hat = (I + [psi x]) C_eb [rad]
N_MOTION: Final = 9  # errors that the motion couples
BA: Final = 9  # accelerometer bias, body [m/s^2]
BG: Final = 12  # gyro bias, body [rad/s]
CLOCK: Final = 15  # receiver clock bias [m]
DRIFT: Final = 16  # receiver clock drift [m/s]
FURTHER: Final = 17  # the first of the further states
