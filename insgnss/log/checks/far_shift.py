"""Shifts of the inertial tags beyond those of every search: minutes, sought with the declared axes alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from insgnss.log.checks.axis_search import QUICK_STEP_S, SCAN_S, SURE, Match, in_motion, is_map, scan
from insgnss.log.checks.declaration import AxesDeclaration
from insgnss.log.checks.stretches import GnssStretch
from insgnss.log.checks.track import GnssTrack
from insgnss.log.checks.vehicle_axes import relative

FARTHEST_S: Final = 1800.0
# The likelihood must peak so many times as high as anywhere else: at the true shift of three logs with motion it is 3
# to 7 times, where no shift is true (their inertial logs run backwards) up to 1.7 times
TIMES: Final = 2.5
_LEAST_WINDOWS: Final = 5  # with motion in common: of fewer the highest peak says little


def far_shift(
    declared: AxesDeclaration,
    track: GnssTrack,
    match: Match | None,
    common: Callable[[float], list[GnssStretch]],
    base_s: float,
) -> float | None:
    """Return what is to be added to the inertial tags, ``base_s`` included, to about a second; None if not far off.

    Parameters
    ----------
    match : of the search around ``base_s``, None without motion in common there
    common : gives the stretches of the track that the inertial log covers, so much added to its tags
    """
    own = relative(declared.accel, declared.gyro)
    near = 0.0 if match is None else match.contrast
    if match is not None and near >= SURE and match.shift_s == 0.0:
        if any(is_map(one, own, declared.factors[0]) for one in match.tied):
            return None
    maps = np.stack([factor * own for factor in declared.factors])
    windows = np.arange(2.0 * SCAN_S, FARTHEST_S, 2.0 * SCAN_S)
    peaks = []
    for centre_s in base_s + np.concatenate((-windows, windows)):
        moving = in_motion(common(float(centre_s)))
        if moving:
            shift_s, contrast = scan(
                declared.imu, track.origin_ns, moving, maps, float(centre_s), QUICK_STEP_S
            )
            peaks.append((contrast, float(centre_s) + shift_s))
    if len(peaks) < _LEAST_WINDOWS:
        return None
    highest, at_s = max(peaks)
    others = [contrast for contrast, shift_s in peaks if abs(shift_s - at_s) > 1.0]
    return at_s if highest > max(TIMES * max([near, *others]), SURE) else None
