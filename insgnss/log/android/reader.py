"""Android GnssLogger files become tables: raw measurements, the phone's sensors, its own fixes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.errors import InputError
from insgnss.log.android.fixes import fixes, unused_fixes
from insgnss.log.android.lines import AndroidCells, AndroidLines, cells, lines_by_kind, refused_lines
from insgnss.log.android.measurements import measurements
from insgnss.log.android.sensors import INERTIAL_KINDS, PhoneClock, further, inertial
from insgnss.log.events import in_file, listed
from insgnss.log.files import file_text
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.receiver import ReceiverLog, no_measurements
from insgnss.tables import Event, NavigationData

# Forward, right, down of a phone that lies flat, its top ahead: its axes are x right, y to the top, z out of the screen
_FLAT: Final = ("+y", "+x", "-z")
COEFFICIENTS: Final = tuple(f"Klobuchar{part}{k}" for part in ("Alpha", "Beta") for k in range(4))
# Without them no pseudorange can be computed
_NEEDED: Final = ("FullBiasNanos", "Svid", "ReceivedSvTimeNanos")


def read_android(*paths: Path) -> ReceiverLog:
    """Read an Android GnssLogger file, or tables made of one (plain or gzipped): of "Raw" lines, of sensors.

    The inertial table has a row for each gyro sample, the specific force interpolated to it, in the phone's axes (x
    right, y to the top, z out of the screen); magnetic field and pressure are the log's further samples. Lines of other
    kinds (orientation, gain control, navigation messages, status) are counted in an event.

    A file may hold inertial samples alone; the table of measurements is empty then, and the phone's fixes date
    the samples, else its UTC.

    Raises
    ------
    InputError : "Raw" lines without their header, two files that hold lines of the same kind, or neither a
        measurement nor an inertial sample that can be used
    """
    path = paths[0]
    kinds = _of_one_phone(paths)
    lines = kinds.get("Raw", AndroidLines())
    columns = set(map(str.lower, lines.columns))
    if lines.texts and "timenanos" not in columns:
        raise InputError(
            "the raw measurements have no header: the line '# Raw,...,TimeNanos,...' is missing",
            file=path,
            advice="keep the comment lines of the log",
        )
    if lines.texts and (missing := [name for name in _NEEDED if name.lower() not in columns]):
        raise InputError(
            f"the raw measurements have no column {', '.join(missing)}",
            file=path,
            advice="convert the log as the phone wrote it; a table made of it keeps the names of its columns",
        )
    raw = cells(lines)
    gnss, receiver, events = measurements(raw)
    events += refused_lines("Raw", raw)
    fix_cells = cells(kinds.get("Fix", AndroidLines()))
    clock = PhoneClock(raw, receiver, fix_cells)
    imu, more_events = inertial(kinds, clock)
    measured = (gnss.pseudorange_m, gnss.doppler_hz, gnss.range_rate_mps)
    searched = bool(len(gnss.t_ns)) and not any(np.isfinite(values).any() for values in measured)
    gnss = no_measurements() if searched else gnss
    if not len(gnss.t_ns) and imu is None:
        raise _nothing_used(path, events + more_events, lines, searched)
    samples, of_samples = further(kinds, clock)
    more_events += of_samples
    read = {"Raw", "Fix", *INERTIAL_KINDS, *(one.source for one in samples)}
    other = {kind: len(lines.texts) for kind, lines in kinds.items() if kind not in read and lines.texts}
    more_events += listed("android_lines_not_read", "lines of other kinds", dict(sorted(other.items())[:10]))
    solution = fixes(fix_cells)
    more_events += refused_lines("Fix", fix_cells) + unused_fixes(fix_cells, solution)
    files = ", ".join(map(str, paths))
    named = in_file(files, events + more_events)
    return ReceiverLog(gnss, _ionosphere(raw), imu, named, solution, imu_axes=_FLAT, further=tuple(samples))


def _ionosphere(raw: AndroidCells) -> NavigationData | None:
    """Return GPS's ionosphere coefficients, which newer phones repeat in each "Raw" line: those that most lines state.

    Lines of constellations other than GPS may leave them empty or zero.
    """
    stated = np.stack([raw.decimals(name) for name in COEFFICIENTS], axis=1)
    stated = stated[np.isfinite(stated).all(axis=1) & stated.any(axis=1)]
    if not len(stated):
        return None
    distinct, count = np.unique(stated, axis=0, return_counts=True)
    broadcast = Broadcast()
    broadcast.ionosphere_of("gps", tuple(distinct[np.argmax(count)].tolist()))
    return broadcast.navigation()


def _nothing_used(path: Path, events: Sequence[Event], lines: AndroidLines, searched: bool) -> InputError:
    """Return the error of a log without a measurement and an inertial sample."""
    why = "; ".join(event.detail for event in events if event.kind != "receiver_clock_discontinuity")
    advice = "switch on 'Raw measurements', and 'Sensors' for inertial samples, in GnssLogger"
    if lines.texts:
        advice = "convert the log as the phone wrote it"
    if searched:
        advice = "log under the open sky until the phone has a fix"
    return InputError(
        f"no measurement and no inertial sample that can be used{': ' + why if why else ''}",
        file=path,
        advice=advice,
    )


def _of_one_phone(paths: Sequence[Path]) -> dict[str, AndroidLines]:
    """Return the lines of all files by kind."""
    kinds: dict[str, AndroidLines] = {}
    for path in paths:
        for kind, lines in lines_by_kind(file_text(path)).items():
            if lines.texts and kinds.get(kind, AndroidLines()).texts:
                raise InputError(
                    f"{len(paths)} files of the format Android GnssLogger, with {kind} lines in more than one",
                    file=path,
                    advice="convert logs one by one, each into a folder of its own; in one call only tables of one"
                    " log, such as device_gnss.csv and device_imu.csv",
                )
            if lines.texts or kind not in kinds:
                kinds[kind] = lines
    return kinds
