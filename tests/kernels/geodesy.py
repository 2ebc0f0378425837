"""Sample calls of the kernels in ``insgnss.geodesy``."""

from __future__ import annotations

import numpy as np

from tests.kernels import KernelCase

_ELLIPSOID = "insgnss.geodesy.ellipsoid"
_ROTATIONS = "insgnss.geodesy.rotations"
_LAT, _LON = 0.97, -2.1
_R_E = np.array([-1_826_000.0, -3_121_000.0, 5_238_000.0])
_Q = np.array([0.5, -0.1, 0.7, 0.5])  # of length one
_TURN = np.array([[0.36, -0.8, 0.48], [0.48, 0.6, 0.64], [-0.8, 0.0, 0.6]])

CASES = [
    KernelCase(f"{_ELLIPSOID}:radii", (_LAT,)),
    KernelCase(f"{_ELLIPSOID}:geodetic_to_ecef", (_LAT, _LON, 1234.5, np.zeros(3))),
    # a height of 1 km is the difference of two lengths of 6e6 m
    KernelCase(f"{_ELLIPSOID}:ecef_to_geodetic", (_R_E,), rtol=1e-11),
    KernelCase("insgnss.geodesy.gravity:normal_gravity_ecef", (_R_E, np.zeros(3))),
    KernelCase("insgnss.geodesy.local_level:up_direction", (_R_E,)),
    KernelCase("insgnss.geodesy.local_level:ecef_to_ned_matrix", (_LAT, _LON, np.zeros((3, 3)))),
    KernelCase(f"{_ROTATIONS}:quaternion_to_matrix", (_Q, np.zeros((3, 3)))),
    KernelCase(f"{_ROTATIONS}:matrix_to_quaternion", (_TURN, np.zeros(4))),
    KernelCase(f"{_ROTATIONS}:euler_to_matrix", (0.3, -0.7, 2.5, np.zeros((3, 3)))),
    KernelCase(f"{_ROTATIONS}:matrix_to_euler", (_TURN,)),
    KernelCase(f"{_ROTATIONS}:turn_left", (_Q, 0.2, -0.5, 0.1)),
    KernelCase(f"{_ROTATIONS}:rotation_vector_quaternion", (0.01, -0.02, 0.03), label="series"),
    KernelCase(f"{_ROTATIONS}:rotation_vector_quaternion", (1.0, -2.0, 0.5), label="trigonometry"),
    KernelCase(
        f"{_ROTATIONS}:write_rotations",
        (np.array([[0.01, -0.02, 0.03], [1.0, -2.0, 0.5]]), np.zeros(4), np.zeros((2, 3, 3))),
    ),
]
