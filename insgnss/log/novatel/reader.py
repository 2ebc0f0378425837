"""NovAtel receivers' logs (OEM4 to OEM7, SPAN): raw measurements, ephemerides, inertial samples, solution.

Read are RANGE, RANGECMP, RANGECMP2; RAWEPHEM and the decoded ephemerides; RAWIMU, RAWIMUS, RAWIMUX, RAWIMUSX; INSPVAX,
INSPVA, BESTPOS with BESTVEL, BESTXYZ; HEADING2 or HEADING, whose heading (no pitch) becomes a further sensor's samples;
with NovAtel's own library RANGECMP3 to RANGECMP5, and all of them in ASCII. All other messages are counted by their
numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.errors import InputError
from insgnss.log.files import file_buffer
from insgnss.log.novatel.frames import frames_in
from insgnss.log.novatel.imu import EXTENDED, INSCONFIG, PLAIN, imu_table
from insgnss.log.novatel.navigation import DECODED, IONUTC, RAW, broadcast
from insgnss.log.novatel.ranges import COMPRESSED_FURTHER, RANGE, RANGECMP, RANGECMP2, measurements
from insgnss.log.novatel.rewritten import rewritten
from insgnss.log.novatel.solution import (
    BESTPOS,
    BESTVEL,
    BESTXYZ,
    HEADING2,
    HEADING_OF_OLD,
    INSPVA,
    INSPVAX,
    headings,
    solution,
)
from insgnss.log.receiver import ReceiverLog, no_measurements

KNOWN: Final = frozenset(
    (
        *(RANGE, RANGECMP, RANGECMP2, *COMPRESSED_FURTHER),
        *(*RAW, *DECODED, IONUTC),
        *(*PLAIN, *EXTENDED, INSCONFIG),
        *(INSPVAX, *INSPVA, BESTPOS, BESTVEL, BESTXYZ, HEADING2, HEADING_OF_OLD),
    )
)


def read_novatel(paths: Sequence[Path], imu_scales: tuple[float, float] | None = None) -> ReceiverLog:
    """Read NovAtel logs (plain or gzipped) of one receiver, merged and in time order.

    A file may hold inertial samples or the receiver's own solution alone; the table of measurements is empty then.

    Parameters
    ----------
    imu_scales : angle [rad] and velocity [m/s] of one count of the inertial sensor; without them the table of the
        sensor's type counts

    Raises
    ------
    InputError : a file cannot be read or holds no NovAtel message, or none of what is read, or needs NovAtel's own
        library, which is not installed
    """
    turned = [rewritten(frames_in(path, file_buffer(path).to_pybytes())) for path in paths]
    files = [frames for frames, _ in turned]
    for frames in files:
        if not frames.count:
            raise InputError(
                "no NovAtel message in the file",
                file=frames.path,
                advice="log RANGEB, RAWEPHEMB, RAWIMUSXB",
            )
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # of numbers that are none, which are looked for everywhere
        gnss, events = measurements(files)
        imu, more_events = imu_table(files, imu_scales)
        own, is_inertial, left_out = solution(files)
        messages = broadcast(files)
        further, no_heading = headings(files)
    events = [*(e for frames in files for e in frames.events(KNOWN)), *events, *more_events]
    events += [*left_out, *no_heading]
    events += [event for _, more_events in turned for event in more_events]
    events += messages.refused_events(paths[0])
    if gnss is None and imu is None and own is None:
        reasons = ("imu_not_used", "novatel_compressed", "novatel_not_used")
        why = "; ".join(e.detail for e in events if e.kind in reasons)
        raise InputError(
            f"the NovAtel log holds no measurement, sample or solution that can be read{': ' + why if why else ''}",
            file=paths[0],
            advice="log RANGEB (or RANGECMPB, RANGECMP2B) with RAWEPHEMB and GLOEPHEMERISB, RAWIMUSXB, INSPVAXB",
        )
    return ReceiverLog(
        no_measurements() if gnss is None else gnss,
        messages.navigation(),
        imu,
        events,
        own,
        imu_is_mean=True,
        solution_point="imu" if is_inertial else "antenna",
        solution_from="filter" if is_inertial else "satellites",
        further=tuple(further),
    )
