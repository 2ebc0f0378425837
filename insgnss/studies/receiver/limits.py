"""Where receivers lose lock: the C/N0 at which half of the runs do, and that of the linear theory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.errors import ConfigError
from insgnss.geodesy.directions import directions
from insgnss.interference.discriminators import ENGINEERING_RATIO, discriminator
from insgnss.interference.linear_threshold import phase_threshold
from insgnss.interference.margin import PhaseLoop
from insgnss.interference.phase_models import UnknownAcceleration, channel_model, one_stage_model
from insgnss.studies.receiver.manoeuvring_covariance import ManoeuvringReceiver
from insgnss.studies.receiver.scene import StudyScene
from insgnss.studies.receiver.variants import Variant
from insgnss.studies.receiver.workspace import ONE_STAGE, SCALAR
from insgnss.tables import Float64
from insgnss.tracking.discriminator_outputs import PHASE_KINDS

_CONFIDENCE: Final = 0.95
_HALF: Final = 0.5
_INS_ERROR: Final = UnknownAcceleration(0.06, 100.0, 0.1, 1e-3)  # what an aided loop is designed for
_NAMES: Final = {"q": "Q", "iq": "IQ", "sign": "sign(I)Q", "atan": "atan(Q/I)"}


def threshold_table(
    summary: pd.DataFrame, linear_dbhz: Mapping[str, float], scene: StudyScene
) -> pd.DataFrame:
    """Return where half of the runs lose lock, a row a receiver; NaN where no share passes one half."""
    rows = []
    for name, table in summary.groupby("variant", sort=False):
        ordered = table.sort_values("cn0_dbhz")
        cn0, runs = ordered["cn0_dbhz"].to_numpy(), ordered["runs"].to_numpy()
        lost = np.rint(ordered["lost"].to_numpy() * runs)
        tail = 0.5 * (1.0 - _CONFIDENCE)
        # the shares that runs as these leave open, by the beta distribution         [Clopper & Pearson 1934]
        least = stats.beta.ppf(tail, np.maximum(lost, 1e-9), runs - lost + 1.0)
        most = stats.beta.ppf(1.0 - tail, lost + 1.0, np.maximum(runs - lost, 1e-9))
        found, low, high = (crossing(cn0, share) for share in (lost / runs, least, most))
        linear = linear_dbhz[str(name)]
        rows.append((name, found, low, high, scene.js_db(found), linear, scene.js_db(linear)))
    columns = ["variant", "cn0_dbhz", "low_dbhz", "high_dbhz", "js_db", "linear_cn0_dbhz", "linear_js_db"]
    return pd.DataFrame(rows, columns=columns)


def crossing(cn0_dbhz: Float64, share: Float64) -> float:
    """Return the C/N0 at which a share that falls with it passes one half; NaN where it does not.

    Parameters
    ----------
    cn0_dbhz : (n,) growing
    """
    falling = np.minimum.accumulate(share)  # more signal does not lose more
    if not (falling[0] >= _HALF > falling[-1]):
        return math.nan
    k = int(np.flatnonzero(falling >= _HALF)[-1])
    part = (falling[k] - _HALF) / (falling[k] - falling[k + 1])
    return float(cn0_dbhz[k] + part * (cn0_dbhz[k + 1] - cn0_dbhz[k]))


def linear_threshold_dbhz(scene: StudyScene, variant: Variant) -> float:
    """Return the threshold of the linear theory; NaN of what it does not know: no phase tracking, other discriminators.

    A channel's, without INS with the vehicle's acceleration, with INS with a residual error of 0.06 m/s^2 over 100 s
    and 0.1 m/s^2 white at 1 ms, whatever IMU is asked for: that of the laboratory's reference table. Of one
    stage that of its 11 states, or of 17 along the motion with the IMU that is asked for.
    """
    setting, kind = scene.setting, PHASE_KINDS[scene.setting.channels.kinds[0]]
    if not setting.channels.coherent or kind not in _NAMES or setting.drift_density <= 0.0:
        return math.nan
    loop = PhaseLoop(discriminator(_NAMES[kind], ENGINEERING_RATIO), scene.bandwidth_hz, setting.truth.step_s)
    sky = directions(scene.azimuth_deg, scene.elevation_deg)
    unknown = UnknownAcceleration(setting.unknown.sigma_mps2, setting.unknown.time_s)
    density, carrier = setting.drift_density, setting.carrier_hz
    try:
        if variant.kind != ONE_STAGE:
            motion = unknown if variant.kind == SCALAR else _INS_ERROR
            return phase_threshold(channel_model(motion, density, carrier), loop).cn0_dbhz
        if setting.inertial is None or setting.grade is None:
            return phase_threshold(one_stage_model(unknown, density, carrier, sky), loop).cn0_dbhz
        receiver = ManoeuvringReceiver.of(
            scene.trajectory, setting.grade, density, carrier, sky, setting.truth.step_s
        )
        settled_s = float(setting.truth.t_s[setting.settle]) - scene.trajectory.first_s
        return receiver.threshold(loop, settle_s=settled_s).cn0_dbhz
    except ConfigError:  # holds everywhere, or nowhere: there is no threshold
        return math.nan
