"""Attitude from several antennas: phase differences, the one-stage filter, the two-stage method, and gyros.

::

    from insgnss.attitude import OneStage, apertures, array_of_vehicle, sky_of_angles, triangle

    array = triangle(1.0)                                   # or AntennaArray of phase centres in body axes,
    array = array_of_vehicle("light_aircraft")              # or those of a file in models/vehicles
    sky = sky_of_angles(az_deg, el_deg, wavelength(hz))     # a wavelength for each signal: GLONASS, several bands
    apertures(rpy, array, sky).width                        # how far an angle may be off
    model = OneStage(array, sky, a, 0.01, rate_noise)       # correlators of all antennas -> angles and rates
    state = model.step(state, Z)

Conventions of this room, besides those of the package:

- The reference frame is north-east-down, or any other that is fixed to the Earth: directions, baselines ``_n`` and
  attitudes ``C_nb`` have to agree. ``roll, pitch, yaw`` are those of (2) of Dneprov and Korogodin, which are the
  package's own.
- Phase differences ``psi`` are in radians, antenna m minus the first one, and grow towards the satellite, as received
  carrier phase does. Differences of ranges have the other sign.
- Small errors of an attitude are rotation vectors in n: ``C_nb_hat = (I + [phi x]) C_nb``.
- Correlators are scaled as in ``insgnss.tracking``: mean a = 2 q T, variance a of each quadrature.
"""

from __future__ import annotations

from insgnss.attitude.angular_discriminators import (
    angular_discriminator,
    angular_noise,
    discriminator_curve,
    likelihood_discriminator,
    pair_discriminator,
    partial_variances,
    slopes,
)
from insgnss.attitude.aperture import Apertures, apertures, random_attitudes
from insgnss.attitude.array_observability import Observability, observability
from insgnss.attitude.attitude_fit import wahba
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    difference_covariance,
    phase_differences,
    phases_by_euler,
    phases_by_rotation,
    sky_of_angles,
    triangle,
    wavelength,
)
from insgnss.attitude.correlator_bank import draw_correlators, measured_differences, signal_ratios
from insgnss.attitude.gyro_attitude import GyroAttitude, GyroErrors, GyroState, gyro_errors
from insgnss.attitude.gyro_trial import Swing, Trial
from insgnss.attitude.one_stage import AttitudeState, OneStage, lock_range, recovery_curve
from insgnss.attitude.two_stage import Epoch, Solution, equivalent_orders, is_turned_over, solve
from insgnss.attitude.vehicle import array_of_vehicle
from insgnss.attitude.wind_up import wind_up_differences

__all__ = [
    "AntennaArray",
    "Apertures",
    "AttitudeState",
    "Epoch",
    "GyroAttitude",
    "GyroErrors",
    "GyroState",
    "Observability",
    "OneStage",
    "Sky",
    "Solution",
    "Swing",
    "Trial",
    "angular_discriminator",
    "angular_noise",
    "apertures",
    "array_of_vehicle",
    "difference_covariance",
    "discriminator_curve",
    "draw_correlators",
    "equivalent_orders",
    "gyro_errors",
    "is_turned_over",
    "likelihood_discriminator",
    "lock_range",
    "measured_differences",
    "observability",
    "pair_discriminator",
    "partial_variances",
    "phase_differences",
    "phases_by_euler",
    "phases_by_rotation",
    "random_attitudes",
    "recovery_curve",
    "signal_ratios",
    "slopes",
    "sky_of_angles",
    "solve",
    "triangle",
    "wahba",
    "wavelength",
    "wind_up_differences",
]
