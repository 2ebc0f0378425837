"""HEADING2 or HEADING, the heading from one antenna to another, as a further sensor's samples.

OEM7 commands and logs reference manual: azimuth of the baseline clockwise from north and its sigma in degrees. The
messages begin alike; HEADING has one station's name where HEADING2 has two.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.log.files import records
from insgnss.log.further_samples import HEADING, FurtherSamples, further_samples
from insgnss.log.novatel.frames import NovatelFrames
from insgnss.log.own_solution import stated_sigmas
from insgnss.tables import Event

HEADING2: Final = 1335
HEADING_OF_OLD: Final = 971
_LAYOUT: Final = np.dtype(
    [
        *(("status", "<u4"), ("kind", "<u4"), ("length_m", "<f4"), ("heading", "<f4"), ("pitch", "<f4")),
        *(("", "<f4"), ("sigma", "<f4"), ("sigma_pitch", "<f4")),
    ]
)
_FIXED: Final = (48, 49, 50)  # position types with integer ambiguities: L1_INT, WIDE_INT, NARROW_INT


def headings(files: list[NovatelFrames]) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the headings with fixed ambiguities and their sigmas, and an event that counts the others.

    The list is empty if there is none. Where a receiver logs both messages, those of HEADING2 count.
    """
    kind = HEADING2 if any(frames.of(HEADING2) for frames in files) else HEADING_OF_OLD
    name = "HEADING2" if kind == HEADING2 else "HEADING"
    chosen = [[f for f in frames.of(kind) if f.length >= _LAYOUT.itemsize] for frames in files]
    if not any(chosen):
        return [], []
    rows = np.concatenate(
        [
            records(frames.data, [f.offset for f in messages], _LAYOUT)
            for frames, messages in zip(files, chosen, strict=True)
        ]
    )
    t_ns = np.array([f.t_ns for messages in chosen for f in messages], np.int64)
    usable = (t_ns >= 0) & (rows["status"] == 0) & np.isin(rows["kind"], _FIXED)
    usable &= np.abs(rows["heading"]) <= 360.0
    events = []
    if not usable.all():
        detail = f"{int((~usable).sum())} {name} message(s) without a heading by fixed ambiguities left out"
        events.append(Event(None, "novatel_no_heading", f"{files[0].path}: {detail}"))
    values = np.column_stack(
        [rows["heading"].astype(np.float64), stated_sigmas(rows["sigma"].astype(np.float64))]
    )
    samples, left_out = further_samples(HEADING, name, t_ns[usable], values[usable])
    return samples, events + left_out
