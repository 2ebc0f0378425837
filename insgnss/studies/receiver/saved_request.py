"""The arguments of a saved receiver study: its settings hold motion, antennas, emitters, sensors and options.

    study.save("out/")
    again = receiver_study(**receiver_request("out/"))    # the same tables, of the same version of the package

An antenna is saved as the kernels read it: its gain on an even grid of elevation (rows, from -90 to 90 deg) and azimuth
(columns, from 0 to 360 deg), the rotation from body to antenna axes, its place, and the angle to the edge of the free
sky in cells of one degree, as pairs of a value and the number of cells in a row that have it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from insgnss.antenna.gain_pattern import Pattern
from insgnss.antenna.installation import N_AZIMUTHS, N_ELEVATIONS, Installation
from insgnss.config.flight import ImuGrade
from insgnss.config.interference import InterferenceConfig
from insgnss.config.simulation import SimulationConfig
from insgnss.errors import ConfigError, ResultError
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.variants import Variant
from insgnss.tables import Int8

SETTINGS_FILE: Final = "receiver_settings.json"
_AS_ASKED: Final = ("tracking", "oscillator", "runs", "seed")


def antenna_settings(antennas: Installation | None) -> list[dict[str, Any]] | None:
    """Return antennas as plain values; None: 0 dBic everywhere."""
    if antennas is None:
        return None
    described = []
    for k, (first, rows, columns) in enumerate(antennas.pattern.shape.tolist()):
        gain = antennas.pattern.gain_dbic[first : first + rows * (columns + 1)].reshape(rows, columns + 1)
        described.append(
            {
                "lever_arm_m": antennas.lever_b[k].tolist(),
                "body_to_antenna": antennas.C_ab[k].tolist(),
                "is_obstructed": bool(antennas.is_obstructed[k]),
                "clearance_deg": _run_lengths(antennas.clearance_deg[k]),
                "gain_dbic": gain.tolist(),
            }
        )
    return described


def antennas_of(described: Sequence[Mapping[str, Any]] | None) -> Installation | None:
    """Return the antennas of ``antenna_settings``."""
    if described is None:
        return None
    gains = [np.array(antenna["gain_dbic"], np.float64) for antenna in described]
    begins = np.cumsum([0, *(gain.size for gain in gains)])
    shape = [(begin, len(gain), gain.shape[1] - 1) for begin, gain in zip(begins, gains, strict=False)]
    per_rad = [((rows - 1) / math.pi, columns / (2.0 * math.pi)) for _, rows, columns in shape]
    return Installation(
        Pattern(
            np.concatenate([np.zeros(0), *(gain.ravel() for gain in gains)]),
            np.array(shape, np.int64).reshape(-1, 3),
            np.array(per_rad, np.float64).reshape(-1, 2),
        ),
        np.array([antenna["body_to_antenna"] for antenna in described], np.float64).reshape(-1, 3, 3),
        np.array([antenna["lever_arm_m"] for antenna in described], np.float64).reshape(-1, 3),
        np.array([_raster(antenna["clearance_deg"]) for antenna in described], np.int8).reshape(
            -1, N_ELEVATIONS, N_AZIMUTHS
        ),
        np.array([antenna["is_obstructed"] for antenna in described], np.bool_),
    )


def receiver_request(folder: str | Path) -> dict[str, Any]:
    """Return the arguments with which ``receiver_study`` repeats a saved study.

    Parameters
    ----------
    folder : that the study was saved into

    Raises
    ------
    ResultError : it holds no receiver study, one without its motion (of an earlier version), or a damaged one
    """
    file = Path(folder) / SETTINGS_FILE
    try:
        saved = json.loads(file.read_text(encoding="utf-8"))
    except OSError:
        advice = "name a folder that a receiver study was saved into"
        raise ResultError("no receiver study is saved here", file=file, advice=advice) from None
    except ValueError as error:
        advice = "save the study again"
        raise ResultError(f"the settings are damaged: {error}", file=file, advice=advice) from None
    try:
        return _arguments(saved)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ConfigError) as error:
        advice = "run the study again with this version and save it"
        raise ResultError(
            f"the settings do not describe a study: {error!r}", file=file, advice=advice
        ) from None


def _arguments(saved: Mapping[str, Any]) -> dict[str, Any]:
    own = {name: Variant(**values) for name, values in saved["own_variants"].items()}
    imu, emitters = saved["imu"], saved["emitters"]
    arguments = {
        "scenario": SimulationConfig.model_validate(saved["scenario_settings"]),
        "variants": tuple(own.get(name, name) for name in saved["variants"]),
        "imu": ImuGrade.model_validate(imu) if isinstance(imu, Mapping) else imu,
        "options": _options(saved["options"]),
        "emitters": None if emitters is None else InterferenceConfig.model_validate(emitters),
        "antennas": antennas_of(saved["antennas"]),
        **{key: saved[key] for key in _AS_ASKED},
    }
    return arguments if emitters is not None else arguments | {"cn0": tuple(saved["cn0"])}


def _options(saved: Mapping[str, Any]) -> ReceiverOptions:
    """Return the options that ``ReceiverOptions.told`` has made plain."""
    lists = ("azimuth_deg", "elevation_deg")
    return ReceiverOptions(
        **{
            **saved,
            **{name: tuple(saved[name]) for name in lists},
            "imu_gaps_s": tuple((begin_s, end_s) for begin_s, end_s in saved["imu_gaps_s"]),
            "symbol_s": float(saved["symbol_s"]),
        }
    )


def _run_lengths(cells: Int8) -> list[list[int]]:
    """Return a raster as pairs of a value and how many cells in a row have it."""
    flat = cells.ravel()
    begins = np.flatnonzero(np.diff(flat, prepend=flat[:1] - 1))
    lengths = np.diff(begins, append=len(flat))
    return [[int(value), int(length)] for value, length in zip(flat[begins], lengths, strict=True)]


def _raster(runs: Sequence[Sequence[int]]) -> Int8:
    """Return the raster of ``_run_lengths``."""
    values, lengths = np.array(runs, np.int64).T
    return np.repeat(values, lengths).astype(np.int8).reshape(N_ELEVATIONS, N_AZIMUTHS)
