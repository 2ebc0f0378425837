"""The time of RTCM's epochs: seconds of a week or a day in the message, the date from elsewhere in the stream.

GPS, Galileo, QZSS and SBAS send milliseconds of GPS's week, BeiDou of its own (14 s behind), GLONASS of the Moscow day.
Ephemerides say the week: Galileo's and BeiDou's with enough bits for this century, GLONASS's as a calendar date where
the receiver hands it on, GPS's modulo 1024 weeks.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_DAY
from insgnss.errors import TimeError
from insgnss.gpstime import (
    BDT_TO_GPS_NS,
    BDT_WEEK_OFFSET,
    GST_WEEK_OFFSET,
    datetime_to_ns,
    glonass_to_ns,
    ns_to_datetime,
    utc_to_ns,
)
from insgnss.log.messages.broadcast import nearest_in_week
from insgnss.log.messages.glonass_strings import nearest_in_day
from insgnss.tables import Event

GPS_WEEKS_SENT: Final = 1024
_MJD_EPOCH: Final = dt.datetime(1858, 11, 17)
_LAST_MJD: Final = 88_127  # 2100-02-28
_OF_DAY_BITS: Final = (1 << 27) - 1  # GLONASS: milliseconds of the day below the day of the week
_GLONASS: Final = "R"
_BEIDOU: Final = "C"


@dataclass(frozen=True)
class StreamDate:
    """A GPS time within some hours of the stream's epochs, and how sure it is."""

    near_ns: int
    declared: dt.date | None = None
    week_assumed: bool = False  # only GPS's week modulo 1024 is known

    def events(self, file: str) -> list[Event]:
        """Return the events about the date."""
        if not self.week_assumed:
            return []
        detail = (
            f"{file}: the stream's GPS week is sent modulo 1024: taken as {ns_to_datetime(self.near_ns):%Y-%m-%d},"
            " the last possible one; declare the date of the first epoch (--date) where that is wrong"
        )
        return [Event(self.near_ns, "rtcm_week_assumed", detail)]

    def agree(self, first_ns: int, file: str) -> None:
        """Raise where the first epoch is not of the declared date.

        Raises
        ------
        TimeError : it is of another day of the week
        """
        if self.declared is None or abs(first_ns - self.near_ns) <= 1.5 * S_PER_DAY * NS_PER_S:
            return
        first_date = ns_to_datetime(first_ns)
        raise TimeError(
            f"the stream's first epoch is on a {first_date:%A}, the declared date {self.declared}"
            f" is a {self.declared:%A}",
            file=file,
            advice=f"declare its own date; the nearest that fits is --date {first_date:%Y-%m-%d}",
        )


class EpochTimes:
    """Turns the times of the epochs, in the order of the stream, into GPS time."""

    def __init__(self, near_ns: int) -> None:
        self._near_ns = near_ns
        self.last_ns: int | None = None  # of the last epoch

    def of(self, system: str, sent_ms: int) -> int:
        """Return the GPS time of an epoch [ns], the one nearest to the epoch before."""
        if system == _GLONASS:
            t_ns = nearest_in_day((sent_ms & _OF_DAY_BITS) / 1000, self._near_ns)
        else:
            shift = BDT_TO_GPS_NS if system == _BEIDOU else 0
            t_ns = nearest_in_week(sent_ms / 1000, self._near_ns - shift) + shift
        self._near_ns = self.last_ns = t_ns
        return t_ns


def stream_date(messages: list[Any], declared: dt.date | None) -> StreamDate | None:
    """Return the approximate time of recording of the stream, None if nothing states it.

    Parameters
    ----------
    messages : decoded ones, in their order
    declared : date of the first epoch, which counts before all messages
    """
    if declared is not None:
        noon = dt.datetime(declared.year, declared.month, declared.day, 12)
        return StreamDate(utc_to_ns(noon), declared)
    times_ns: dict[int, int] = {}
    for message in messages:
        if message.message_number not in times_ns:
            times_ns.update((message.message_number, t_ns) for t_ns in _dates(message))
    for number in (1013, 1046, 1045, 1042, 1020, 1029):
        if number in times_ns:
            return StreamDate(times_ns[number])
    for number in (1019, 1044):
        if number in times_ns:
            # the last time with this week modulo 1024 that is not after today
            now = dt.datetime.now(dt.UTC).replace(tzinfo=None)
            tomorrow_ns = datetime_to_ns(now) + S_PER_DAY * NS_PER_S
            period = GPS_WEEKS_SENT * NS_PER_WEEK
            cycles = (tomorrow_ns - times_ns[number]) // period
            return StreamDate(times_ns[number] + cycles * period, week_assumed=True)
    return None


def _dates(message: Any) -> Iterator[int]:
    """Yield the date that a message states; GPS's in its first cycle of 1024 weeks."""
    number = message.message_number
    if number in (1013, 1029):
        stated = message.system_parameters or message.text_message
        if stated is not None and 0 < stated.mjd < _LAST_MJD:
            yield utc_to_ns(
                _MJD_EPOCH + dt.timedelta(days=stated.mjd, seconds=min(stated.seconds_of_day, S_PER_DAY - 1))
            )
    elif number in (1045, 1046):
        galileo = message.galileo_inav_ephemeris or message.galileo_fnav_ephemeris
        yield (galileo.week_number + GST_WEEK_OFFSET) * NS_PER_WEEK + galileo.t_oe * 60 * NS_PER_S
    elif number == 1042:
        beidou = message.beidou_ephemeris
        weeks = (beidou.week_number + BDT_WEEK_OFFSET) * NS_PER_WEEK
        yield weeks + beidou.t_oe * 8 * NS_PER_S + BDT_TO_GPS_NS
    elif number == 1020:
        glonass = message.glonass_ephemeris
        if glonass.m_n4 > 0 and 0 < glonass.m_n_t <= 1461:
            yield glonass_to_ns(glonass.m_n4, glonass.m_n_t, glonass.t_b * 900)
    elif number in (1019, 1044):
        gps = message.gps_ephemeris or message.qzss_ephemeris
        yield gps.week_number * NS_PER_WEEK + gps.t_oe * 16 * NS_PER_S
