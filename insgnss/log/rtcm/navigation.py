"""RTCM's ephemerides (1019, 1020, 1042, 1044, 1045, 1046) become the tables of ``insgnss.tables``.

The messages hold the numbers as the satellites sent them, with the scales of each system's interface document
(RTCM 10403.3, tables 3.5-21, 3.5-24, 3.5-105 and after).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from insgnss.constants import M_PER_KM, NS_PER_S, NS_PER_WEEK
from insgnss.gnss.signals import CHANNEL_OFFSET, CHANNELS, UNKNOWN_CHANNEL
from insgnss.gpstime import BDT_TO_GPS_NS, BDT_WEEK_OFFSET
from insgnss.log.messages.beidou import beidou_message
from insgnss.log.messages.bits import angle, power
from insgnss.log.messages.broadcast import Broadcast, Stated, StateVector
from insgnss.log.messages.galileo import health_bits, sisa_m
from insgnss.log.messages.glonass_strings import nearest_in_day
from insgnss.log.messages.gps_lnav import fit_interval_s, ura_m
from insgnss.log.rtcm.time import GPS_WEEKS_SENT
from insgnss.log.satellites import rinex_name

_FAR_NS: Final = 2 * 86_400 * NS_PER_S  # of a message's week from that of the epochs
_ANGLES: Final = {
    **{"i0": -31, "omega0": -31, "omega": -31, "m0": -31},
    **{"delta_n": -43, "omega_dot": -43, "idot": -43},
}
# Scales of toc and toe [s], af0 af1 af2, cu and ci, cr; e and sqrt(a) are the same in all
_GPS: Final = (16.0, (-31, -43, -55), -29, -5)
_GALILEO: Final = (60.0, (-34, -46, -59), -29, -5)
_BEIDOU: Final = (8.0, (-33, -50, -66), -31, -6)


def broadcast(messages: Sequence[tuple[Any, int]]) -> Broadcast:
    """Return the ephemerides, each distinct one once.

    Parameters
    ----------
    messages : each with the GPS time of the epochs about it [ns]
    """
    ephemerides = Broadcast()
    for message, near_ns in messages:
        EPHEMERIDES[message.message_number](ephemerides, message, near_ns)
    return ephemerides


def stated_channels(messages: Sequence[Any]) -> dict[str, int]:
    """Return the frequency channels of the GLONASS satellites that sent their ephemeris."""
    states = [message.glonass_ephemeris for message in messages if message.message_number == 1020]
    channels = {f"R{state.satellite_id:02d}": state.frequency_channel - CHANNEL_OFFSET for state in states}
    return {sv: channel for sv, channel in channels.items() if channel in CHANNELS}


def _elements(row: Any, scales: tuple[float, tuple[int, int, int], int, int]) -> tuple[float, ...]:
    """Return the elements in the order of ``ELEMENTS``."""
    times, clock, angles, radii = scales
    return (
        row.t_oe * times,
        *(raw * power(exponent) for raw, exponent in zip((row.a_f0, row.a_f1, row.a_f2), clock, strict=True)),
        row.sqrt_a * power(-19),
        row.eccentricity * power(-33),
        *(getattr(row, name) * angle(exponent) for name, exponent in _ANGLES.items()),
        *(raw * power(angles) for raw in (row.c_uc, row.c_us)),
        *(raw * power(radii) for raw in (row.c_rc, row.c_rs)),
        *(raw * power(angles) for raw in (row.c_ic, row.c_is)),
    )


def _lnav(system: str) -> Callable[[Broadcast, Any, int], None]:
    def take(ephemerides: Broadcast, message: Any, near_ns: int) -> None:
        row = message.gps_ephemeris or message.qzss_ephemeris
        sv = rinex_name(system, row.satellite_id)
        sent_ns = row.week_number * NS_PER_WEEK + int(row.t_oe * 16) * NS_PER_S
        if not _is_near(ephemerides, sv, sent_ns, near_ns, GPS_WEEKS_SENT, message):
            return
        fit = fit_interval_s(system, int(row.fit_interval), row.iodc)
        health, accuracy = float(row.sv_health), ura_m(row.sv_accuracy if system == "G" else row.ura)
        delay = 0.0 if system == "J" and row.t_gd == -128 else row.t_gd * power(-31)  # "not available"
        stated = Stated((delay, 0.0), health, accuracy, float(row.iode), fit)
        ephemerides.keep(sv, "LNAV", stated, _elements(row, _GPS), row.t_oc * _GPS[0], near_ns)

    return take


def _galileo(ephemerides: Broadcast, message: Any, near_ns: int) -> None:
    inav = message.galileo_inav_ephemeris
    row = inav or message.galileo_fnav_ephemeris
    sv = rinex_name("E", row.satellite_id)
    sent_ns = (row.week_number + 1024) * NS_PER_WEEK + row.t_oe * 60 * NS_PER_S
    if not _is_near(ephemerides, sv, sent_ns, near_ns, 4096, message):
        return
    if inav:
        health = health_bits(
            e1=(row.e1b_data_validity, row.e1b_signal_health),
            e5b=(row.e5b_data_validity, row.e5b_signal_health),
        )
    else:
        health = health_bits(e5a=(row.e5a_data_validity, row.e5a_signal_health))
    delays = (row.bgd_e5a_e1 * power(-32), row.bgd_e5b_e1 * power(-32) if inav else 0.0)
    accuracy = sisa_m(row.sisa_index if inav else row.sisa)
    stated = Stated(delays, health, accuracy, float(row.iod_nav))
    kind = "INAV" if inav else "FNAV"
    ephemerides.keep(sv, kind, stated, _elements(row, _GALILEO), row.t_oc * _GALILEO[0], near_ns)


def _beidou(ephemerides: Broadcast, message: Any, near_ns: int) -> None:
    row = message.beidou_ephemeris
    sv = rinex_name("C", row.satellite_id)
    sent_ns = (row.week_number + BDT_WEEK_OFFSET) * NS_PER_WEEK + row.t_oe * 8 * NS_PER_S + BDT_TO_GPS_NS
    if not _is_near(ephemerides, sv, sent_ns, near_ns, 8192, message):
        return
    delays = (row.t_gd1 * 1e-10, row.t_gd2 * 1e-10)
    stated = Stated(delays, float(row.sv_health), ura_m(row.sv_urai), float(row.aode))
    ephemerides.keep(sv, beidou_message(sv), stated, _elements(row, _BEIDOU), row.t_oc * _BEIDOU[0], near_ns)


def _is_near(ephemerides: Broadcast, sv: str, sent_ns: int, near_ns: int, weeks: int, message: Any) -> bool:
    """Return whether a message has a satellite and is of the epochs' days, its week sent modulo ``weeks``.

    A reference time at the week's edge may be one week off the week sent.
    """
    period = weeks * NS_PER_WEEK
    off_ns = (sent_ns - near_ns + period // 2) % period - period // 2
    off_ns = min((off_ns, off_ns - NS_PER_WEEK, off_ns + NS_PER_WEEK), key=abs)
    why = "without a known satellite" if not sv else "of another date" if abs(off_ns) > _FAR_NS else ""
    if why:
        ephemerides.refused[f"message {message.message_number} {why}; refused"] += 1
    return not why


def _glonass(ephemerides: Broadcast, message: Any, near_ns: int) -> None:
    row = message.glonass_ephemeris
    sv = rinex_name("R", row.satellite_id)
    if not sv or row.t_b * 900 >= 86_400:
        ephemerides.refused["message 1020 without a known satellite or time; refused"] += 1
        return
    channel = row.frequency_channel - CHANNEL_OFFSET
    r_e, v_e, a_e = (
        tuple(getattr(row, f"{axis}n{dots}") * power(scale) * M_PER_KM for axis in "xyz")
        for dots, scale in (("", -11), ("_dot", -20), ("_dot_dot", -30))
    )
    state = StateVector(
        sv,
        nearest_in_day(row.t_b * 900, near_ns),
        r_e,
        v_e,
        a_e,
        -row.tau_n * power(-30),  # ICD: t_GLONASS = t_satellite + tau
        row.gamma_n * power(-40),
        row.delta_tau_n * power(-30),
        float(int(row.b_n_msb) | int(row.m_l_n_third) << 1),
        channel if channel in CHANNELS else UNKNOWN_CHANNEL,
    )
    ephemerides.states.setdefault(state)


EPHEMERIDES: Final[dict[int, Callable[[Broadcast, Any, int], None]]] = {
    **{1019: _lnav("G"), 1020: _glonass, 1042: _beidou},
    **{1044: _lnav("J"), 1045: _galileo, 1046: _galileo},
}
