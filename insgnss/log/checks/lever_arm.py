"""The lever arm estimated from the log, and its effect in this log.

The antenna moves with v + C_es (w x l): where the vehicle turns about two axes all of l shows in the velocities, in a
flat turn its horizontal part alone.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.log.checks.declaration import AxesDeclaration
from insgnss.log.checks.refinement import LEVER, RefinedEstimate
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.checks.time_offset import SIGNIFICANT_SIGMAS
from insgnss.log.checks.track import GnssTrack
from insgnss.log.flight import Flight
from insgnss.tables import Float64

KNOWN_SD_M: Final = 0.20  # of each component, for a proposal
FAR_M: Final = 0.7  # a given lever arm that is off by less is not doubted: scale and flexing do that
FELT_MPS: Final = 0.05  # a velocity that a single epoch shows


def lever_arm_findings(
    flight: Flight, refined: RefinedEstimate, accel: Float64, declared: AxesDeclaration, track: GnssTrack
) -> list[Finding]:
    """Return the findings on the lever arm from IMU to antenna.

    Parameters
    ----------
    refined : estimates in sensor axes
    accel : (3, 3) the right map of the sensor axes to the body's
    """
    lever_b = accel @ refined.x[LEVER]
    P = accel @ refined.P[LEVER, LEVER] @ accel.T
    sd = np.sqrt(np.diag(P))
    shown = "(" + ", ".join(f"{v:+.2f} +- {s:.2f}" for v, s in zip(lever_b, sd, strict=True)) + ") m"
    given = flight.config.gnss.lever_b
    if given is not None:
        off = lever_b - np.array(given)
        doubt = float(np.sqrt(off @ np.linalg.solve(P, off)))
        if doubt < SIGNIFICANT_SIGMAS or float(np.linalg.norm(off[sd < 2.0 * FAR_M])) < FAR_M:
            return [
                Finding(
                    "ok",
                    "motion",
                    f"lever arm estimated from the turns {shown}: consistent with the declared one",
                )
            ]
        text = (
            f"lever arm estimated from the turns {shown} forward, right, down: differs from the declared one"
        )
        return [Finding("warning", "motion", text, "measure it again", f"{doubt:.0f} sigmas off")]
    rms, most = _moved(declared, track)
    effect = f"each metre of it moves the antenna by up to {most:.2f} m/s (rms {rms:.2f}) in this log"
    text = f"lever arm estimated from the turns {shown} forward, right, down; {effect}"
    known = bool((sd < KNOWN_SD_M).all())
    if known and float(np.linalg.norm(lever_b)) > SIGNIFICANT_SIGMAS * float(sd.max()):
        value = (round(float(lever_b[0]), 2), round(float(lever_b[1]), 2), round(float(lever_b[2]), 2))
        proposal = Proposal("gnss.lever_arm_m", value, "estimated from the turns; a measured one is better")
        return [Finding("warning", "motion", text, "a measured lever arm is better", "likely", (proposal,))]
    if most < FELT_MPS:
        return [Finding("ok", "motion", text, "it hardly matters in this log")]
    return [Finding("ok", "motion", text, "not known well enough to be proposed: measure it")]


def _moved(declared: AxesDeclaration, track: GnssTrack) -> tuple[float, float]:
    """Return rms and largest velocity [m/s] of an antenna a metre away, over seconds of the common time."""
    t_s = (declared.imu.t_ns - track.origin_ns) / NS_PER_S
    inside = (t_s >= track.t_s[0]) & (t_s <= track.t_s[-1])
    if int(inside.sum()) < 2:
        return 0.0, 0.0
    w, t = declared.imu.w_ib_b[inside], t_s[inside]
    second = ((t - t[0]) // 1.0).astype(np.int64)
    count = np.bincount(second)
    full = count > 0.5 * np.median(count[count > 0])
    sums = np.stack([np.bincount(second, w[:, axis]) for axis in range(3)], axis=1)
    rate = np.linalg.norm(sums[full] / count[full, None], axis=1)
    return float(np.sqrt(np.mean(rate**2))), float(rate.max())
