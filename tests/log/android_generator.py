"""Writes GnssLogger files from satellites with known distances: the source of the tests, independent of the reader.

Everything is counted in whole nanoseconds with Python's integers and written as the application does.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

C_MPS = 299_792_458
WEEK_NS = 604_800 * 10**9
DAY_NS = 86_400 * 10**9
BOOT_FULL_BIAS_NS = -1_400_000_000_123_456_789  # GPS time when the phone's clock read zero, negative
COLUMNS = (
    "utcTimeMillis,TimeNanos,LeapSecond,TimeUncertaintyNanos,FullBiasNanos,BiasNanos,BiasUncertaintyNanos,"
    "DriftNanosPerSecond,DriftUncertaintyNanosPerSecond,HardwareClockDiscontinuityCount,Svid,TimeOffsetNanos,State,"
    "ReceivedSvTimeNanos,ReceivedSvTimeUncertaintyNanos,Cn0DbHz,PseudorangeRateMetersPerSecond,"
    "PseudorangeRateUncertaintyMetersPerSecond,AccumulatedDeltaRangeState,AccumulatedDeltaRangeMeters,"
    "AccumulatedDeltaRangeUncertaintyMeters,CarrierFrequencyHz,CarrierCycles,CarrierPhase,CarrierPhaseUncertainty,"
    "MultipathIndicator,SnrInDb,ConstellationType,AgcDb,BasebandCn0DbHz,FullInterSignalBiasNanos,"
    "FullInterSignalBiasUncertaintyNanos,SatelliteInterSignalBiasNanos,SatelliteInterSignalBiasUncertaintyNanos,"
    "CodeType,ChipsetElapsedRealtimeNanos"
)
HEADER = (
    "# \n# Header Description:\n# \n# Version: v3.0.6.4 Platform: 14 Manufacturer: x Model: y\n# \n"
    f"# Raw,{COLUMNS}\n# \n"
    "# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,BiasXMps2,"
    "BiasYMps2,BiasZMps2\n"
    "# UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec,"
    "DriftXRadPerSec,DriftYRadPerSec,DriftZRadPerSec\n"
    "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters\n# \n"
)
ELAPSED_MINUS_TIME_NS = 77_000_000_000  # the system's clock against the receiver's


@dataclass(frozen=True)
class Sat:
    """One measurement; ``travel_ns`` is what the signal took, receiver clock included."""

    constellation: int
    svid: int
    travel_ns: int
    carrier_hz: float | None = None
    code: str = ""
    state: int = 0x1 | 0x8 | 0x4000
    rate_mps: float = 12.5
    adr_state: int = 0
    adr_m: float = 0.0
    offset_ns: float = 0.0
    drop: str = ""  # a column whose cell is left empty
    sent_uncertainty_ns: float | None = None
    rate_uncertainty_mps: float | None = None


def sent_ns(sat: Sat, gps_ns: int, leap: int) -> int:
    """The satellite's own clock at transmission, in its week, day or 100 ms."""
    at = gps_ns - sat.travel_ns
    if sat.constellation == 5:
        return (at - 14 * 10**9) % WEEK_NS
    if sat.constellation == 3:
        return (at + (3 * 3600 - leap) * 10**9) % DAY_NS
    if sat.constellation == 6 and not sat.state & 0x4008:
        return at % 10**8
    return at % WEEK_NS


def epoch(
    time_ns: int,
    sats: Iterable[Sat],
    count: int = 0,
    bias_ns: float = 0.25,
    extra_bias: int = 0,
    leap: int = 18,
    full: int | None = None,
    bias_uncertainty_ns: float | None = None,
) -> str:
    """The "Raw" lines of one epoch at the receiver clock's ``time_ns``; ``full`` is logged instead of the true bias."""
    gps_ns = time_ns - (BOOT_FULL_BIAS_NS + extra_bias)
    lines = []
    for sat in sats:
        cell = {
            "utcTimeMillis": (gps_ns // 10**6) + 315_964_800_000 - leap * 1000,
            "TimeNanos": time_ns,
            "LeapSecond": leap,
            "FullBiasNanos": BOOT_FULL_BIAS_NS + extra_bias if full is None else full,
            "BiasNanos": bias_ns,
            "BiasUncertaintyNanos": _or_empty(bias_uncertainty_ns),
            "ReceivedSvTimeUncertaintyNanos": _or_empty(sat.sent_uncertainty_ns),
            "PseudorangeRateUncertaintyMetersPerSecond": _or_empty(sat.rate_uncertainty_mps),
            "HardwareClockDiscontinuityCount": count,
            "Svid": sat.svid,
            "TimeOffsetNanos": sat.offset_ns,
            "State": sat.state,
            "ReceivedSvTimeNanos": sent_ns(sat, gps_ns + round(sat.offset_ns), leap),
            "Cn0DbHz": 35.5,
            "PseudorangeRateMetersPerSecond": sat.rate_mps,
            "AccumulatedDeltaRangeState": sat.adr_state,
            "AccumulatedDeltaRangeMeters": sat.adr_m,
            "CarrierFrequencyHz": "" if sat.carrier_hz is None else sat.carrier_hz,
            "ConstellationType": sat.constellation,
            "CodeType": sat.code,
            "ChipsetElapsedRealtimeNanos": time_ns + ELAPSED_MINUS_TIME_NS,
        }
        cell[sat.drop] = ""
        lines.append("Raw," + ",".join(str(cell.get(name, "")) for name in COLUMNS.split(",")))
    return "\n".join(lines) + "\n"


def _or_empty(value: float | None) -> str:
    return "" if value is None else str(value)


def sensor(
    kind: str,
    elapsed_ns: int,
    xyz: tuple[float, float, float],
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> str:
    gps_ns = elapsed_ns - ELAPSED_MINUS_TIME_NS - BOOT_FULL_BIAS_NS
    utc_ms = gps_ns // 10**6 + 315_964_800_000 - 18_000
    return f"{kind},{utc_ms},{elapsed_ns},{xyz[0]},{xyz[1]},{xyz[2]},{bias[0]},{bias[1]},{bias[2]}\n"
