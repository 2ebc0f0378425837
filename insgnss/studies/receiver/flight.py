"""What a receiver study flies: its scene, C/N0 over time, and the second of a run from which errors are averaged.

Errors are averaged from one moment on for all receivers and C/N0: when the slowest of them has settled at the lowest
C/N0 (``settling``), at most ``LONGEST_WAIT_S`` after the fall. A position of code and phase (``one_stage_code``) is not
waited for: it is an average since the run's begin and never settles. Past emitters C/N0 does not fall once; the average
then begins with ``settle_s``, and a study whose duration is not given lasts as long as the motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.equipment import limits_of
from insgnss.antenna.installation import Installation
from insgnss.config.filter import Visibility
from insgnss.config.flight import ImuGrade
from insgnss.config.interference import InterferenceConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.errors import ConfigError
from insgnss.studies.receiver.admission import check_options, require_answers
from insgnss.studies.receiver.antennas import ReceiverMasking, emitters_of, gain_dbic, jammed_cn0_dbhz
from insgnss.studies.receiver.options import AVERAGED_S, LONGEST_WAIT_S, ReceiverOptions
from insgnss.studies.receiver.scene import StudyScene, scene_of
from insgnss.studies.receiver.settling import SETTLED_DBHZ, Fall, settling_s
from insgnss.studies.receiver.variants import Variant
from insgnss.tables import Float64

_AVERAGED_SINCE_BEGIN: Final = ("position", "clock")
_SLACK: Final = (
    0.1  # of the averaged time before an error has settled: its mean square is below by a few per cent
)


class FlightRequest(NamedTuple):
    """What is asked of a study, except for its receivers."""

    scenario: str | Path | SimulationConfig
    tracking: str
    imu: str | ImuGrade | None
    oscillator: str | Mapping[str, float]
    options: ReceiverOptions
    emitters: InterferenceConfig | str | Path | None = None
    antennas: Installation | None = None


@dataclass(frozen=True)
class ReceiverFlight:
    """A study's scene, with all of its times in ``scene.options``."""

    scene: StudyScene
    profiles: Mapping[float, Float64]  # C/N0 over time, (n, 1) or (n, m), by the level that names it
    # errors of a receiver at a C/N0 that have not settled within the first tenth of the average; "": none
    unsettled: Mapping[tuple[str, float], str]


def receiver_flight(
    asked: FlightRequest, wanted: Mapping[str, Variant], levels: list[float], threads: int = 1
) -> ReceiverFlight:
    """Return the scenario that the receivers fly through.

    Parameters
    ----------
    levels : of C/N0 [dBHz], the highest first

    Raises
    ------
    ConfigError, ModelError : an unknown name, numbers that make no sense, a motion shorter than the study, or receivers
        that cannot give a result
    """
    o = asked.options
    if not (asked.antennas is None or isinstance(asked.antennas, Installation)):
        advice = "give an Installation of the vehicle's antennas, or None"
        raise ConfigError(f"{asked.antennas!r} is not a set of antennas", key="antennas", advice=advice)
    check_options(o)
    if asked.emitters is not None and o.average_s is None:
        asked = asked._replace(options=replace(o, average_s=o.settle_s))
    scene, profiles = _scene(asked, levels)
    require_answers(scene.setting, wanted, profiles)
    if asked.emitters is not None:
        return ReceiverFlight(scene, profiles, {})
    settles = _Settling(scene, asked.antennas, wanted, threads)
    slowest = settles.at(levels[-1])
    if asked.options.average_s is None:
        chosen = _with_average(asked.options, scene.options, slowest, wanted)
        scene, profiles = _scene(asked._replace(options=chosen), levels)
    after_s = _latest_s(scene)
    late = {name: _late(waits_s, after_s) for name, waits_s in slowest.items()}
    unsettled = {(name, levels[-1]): words for name, words in late.items()}
    if any(late.values()):  # more signal settles sooner
        for level in levels[:-1]:
            waits_s = settles.at(level)
            unsettled |= {(name, level): _late(waits_s[name], after_s) for name in wanted}
    return ReceiverFlight(scene, profiles, unsettled)


def _latest_s(scene: StudyScene) -> float:
    """Return how long after the fall an error that counts as settled may take [s]."""
    truth, first = scene.setting.truth, scene.setting.settle
    return truth.step_s * (first + _SLACK * (len(truth.t_s) - first) - scene.fall) + 1e-9


def _late(waits_s: Mapping[str, float], after_s: float) -> str:
    """Return the names of errors that settle later than ``after_s``."""
    return ", ".join(name for name, wait_s in waits_s.items() if wait_s > after_s)


class _Settling:
    """When the receivers of a study settle."""

    def __init__(
        self, scene: StudyScene, antennas: Installation | None, wanted: Mapping[str, Variant], threads: int
    ) -> None:
        self._scene, self._wanted, self._threads = scene, wanted, threads
        self._gain = _gain(scene, antennas)

    def at(self, level: float) -> dict[str, dict[str, float]]:
        """Return how long after the fall to a C/N0 the errors of each receiver take [s]."""
        scene, gain = self._scene, self._gain
        fall = Fall(scene.fall, _profile(level, gain, scene.fall), _profile(level, gain, 0), level)
        with ThreadPoolExecutor(self._threads) as pool:
            waits_s = pool.map(
                lambda variant: settling_s(scene.setting, variant, fall), self._wanted.values()
            )
            return dict(zip(self._wanted, waits_s, strict=True))


def _with_average(
    asked: ReceiverOptions,
    longest: ReceiverOptions,
    slowest: Mapping[str, Mapping[str, float]],
    wanted: Mapping[str, Variant],
) -> ReceiverOptions:
    """Return options whose average begins when all receivers have settled, and does not leave too little of the run."""
    waits = [
        wait_s
        for name, of_receiver in slowest.items()
        for of, wait_s in of_receiver.items()
        if not (wanted[name].with_code and of in _AVERAGED_SINCE_BEGIN)
    ]
    assert longest.duration_s is not None
    settle_s, end_s = asked.settle_s, longest.duration_s
    wait_s = math.ceil(min(max(waits), LONGEST_WAIT_S))
    average_s = min(settle_s + wait_s, max(end_s - AVERAGED_S, 0.5 * (settle_s + end_s)))
    if asked.duration_s is None:
        end_s = min(average_s + AVERAGED_S, end_s)
    return replace(asked, average_s=average_s, duration_s=end_s)


def _scene(asked: FlightRequest, levels: list[float]) -> tuple[StudyScene, dict[float, Float64]]:
    """Return the scene and C/N0 over time by the level that names it."""
    scene = scene_of(
        *(asked.scenario, asked.tracking, asked.imu, asked.oscillator, asked.options),
        whole=asked.emitters is not None,
    )
    scene = _masked(scene, asked.options, asked.antennas)
    if asked.emitters is not None:
        jammed = jammed_cn0_dbhz(
            scene.setting.truth, emitters_of(asked.emitters), scene.start_s, asked.antennas
        )
        return scene, {round(float(jammed.min()), 2): jammed}
    gain = _gain(scene, asked.antennas)
    return scene, {level: _profile(level, gain, scene.fall) for level in levels}


def _gain(scene: StudyScene, antennas: Installation | None) -> Float64:
    """Return the antennas' gain over time, (n, 1) or (n, m) [dBic]."""
    truth = scene.setting.truth
    return np.zeros((len(truth.t_s), 1)) if antennas is None else gain_dbic(truth, antennas)


def _profile(level: float, gain: Float64, fall: int) -> Float64:
    """Return C/N0 over time that falls to a level."""
    profile = np.full((len(gain), 1), level)
    profile[:fall] = max(SETTLED_DBHZ, level)
    return profile + gain


def _masked(scene: StudyScene, options: ReceiverOptions, antennas: Installation | None) -> StudyScene:
    """Return a scene whose receivers mask by attitude, where that is asked for.

    Raises
    ------
    ConfigError : no antennas or no inertial system to do it with
    """
    if not options.masking:
        return scene
    if antennas is None or scene.setting.inertial is None:
        advice = "give antennas, and an inertial system for the attitude"
        raise ConfigError("hidden satellites cannot be determined", key="masking", advice=advice)
    masking = ReceiverMasking(antennas, limits_of(Visibility()))
    return replace(scene, setting=replace(scene.setting, masking=masking))
