"""Facts of 2010-07-01: two satellites' final orbits and clocks (IGS, igs15904), their broadcast messages and antennas.

Positions in km, clocks in microseconds, every 15 min from midnight, as the International GNSS Service published them;
the messages are those of 02:00 from the day's merged broadcast file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.precise import read_precise
from insgnss.log.rinex.navigation import read_navigation
from insgnss.tables import EphemerisTable, PreciseProducts

START_NS = int(week_seconds_to_ns(1590, 345_600.0))
STEP_S = 900
ORBITS: dict[str, tuple[tuple[float, float, float, float], ...]] = {
    "G05": (
        (-25251.856884, 1285.343331, -8289.755668, -10.679384),
        (-24286.536246, 727.556810, -10843.852758, -10.681694),
        (-23092.684626, 18.520859, -13212.307897, -10.684100),
        (-21706.646637, -860.312118, -15354.526945, -10.686706),
        (-20169.174514, -1920.235192, -17233.751768, -10.688942),
        (-18523.919108, -3164.655383, -18817.685305, -10.691191),
        (-16815.821057, -4588.767026, -20079.043988, -10.693643),
        (-15089.462879, -6179.543813, -20996.028382, -10.695999),
        (-13387.444361, -7916.051375, -21552.703963, -10.698407),
        (-11748.842906, -9770.070126, -21739.285240, -10.700762),
        (-10207.817480, -11707.006326, -21552.317763, -10.703182),
        (-8792.409673, -13687.058214, -20994.754046, -10.705783),
        (-7523.588047, -15666.594119, -20075.920997, -10.708163),
        (-6414.572949, -17599.691025, -18811.378164, -10.710556),
    ),
    "G20": (
        (20337.943541, -14083.157165, -9732.408001, 53.950532),
        (21336.926242, -14125.741115, -7150.268927, 53.949437),
        (22059.341351, -14099.065998, -4445.204047, 53.949275),
        (22506.724267, -13966.822291, -1663.597609, 53.948808),
        (22688.775205, -13694.812621, 1146.692092, 53.948273),
        (22622.891569, -13252.454410, 3937.155518, 53.948133),
        (22333.408871, -12614.157398, 6659.476861, 53.947951),
        (21850.577889, -11760.519929, 9266.385923, 53.947293),
        (21209.316730, -10679.294376, 11712.500777, 53.946773),
        (20447.785994, -9366.080661, 13955.144657, 53.946423),
        (19605.843037, -7824.717418, 15955.120502, 53.945863),
        (18723.436812, -6067.352338, 17677.426990, 53.945475),
        (17839.007755, -4114.186296, 19091.900899, 53.945289),
        (16987.957404, -1992.899238, 20173.771955, 53.944701),
    ),
}
# every 5 min from midnight [s]
CLOCKS: dict[str, tuple[float, ...]] = {
    "G05": (
        -1.067938443455e-05,
        -1.068013197365e-05,
        -1.068106494322e-05,
        -1.068169418022e-05,
        -1.068251330675e-05,
        -1.068346811389e-05,
        -1.068409985399e-05,
    ),
    "G20": (
        5.395053187595e-05,
        5.395006231855e-05,
        5.394958807078e-05,
        5.394943651788e-05,
        5.394950892315e-05,
        5.394951717611e-05,
        5.394927501371e-05,
    ),
}
NAVIGATION = """\
     3.04           N: GNSS NAV DATA    G: GPS              RINEX VERSION / TYPE
                                                            END OF HEADER
G05 2010 07 01 02 00 00-0.106976367533E-04-0.272848410532E-11 0.000000000000E+00
     0.660000000000E+02-0.136562500000E+02 0.462769289555E-08-0.194302435840E+01
    -0.659376382828E-06 0.181570090354E-02 0.679120421410E-05 0.515373050690E+04
     0.352800000000E+06-0.316649675369E-07-0.214642955461E+00-0.372529029846E-08
     0.958134627959E+00 0.248625000000E+03 0.242772833743E+00-0.808105049543E-08
    -0.426803481446E-09 0.100000000000E+01 0.159000000000E+04 0.000000000000E+00
     0.200000000000E+01 0.000000000000E+00-0.884756445885E-08 0.660000000000E+02
     0.345798000000E+06 0.400000000000E+01 0.000000000000E+00 0.000000000000E+00
G20 2010 07 01 02 00 00 0.539440661669E-04-0.454747350886E-12 0.000000000000E+00
     0.104000000000E+03-0.146562500000E+02 0.526164774018E-08-0.735604940693E+00
    -0.799074769020E-06 0.416606711224E-02 0.646151602268E-05 0.515357927513E+04
     0.352800000000E+06-0.242143869400E-07-0.243569492116E+00 0.707805156708E-07
     0.936999328206E+00 0.240531250000E+03 0.132234785513E+01-0.850356849348E-08
    -0.475734101949E-09 0.100000000000E+01 0.159000000000E+04 0.000000000000E+00
     0.200000000000E+01 0.000000000000E+00-0.791624188423E-08 0.104000000000E+03
     0.350040000000E+06 0.000000000000E+00 0.000000000000E+00 0.000000000000E+00
"""
# igs05.atx: z offsets of both frequencies [mm], first day
ANTENNAS = {"G05": ("BLOCK IIR-M", 700.0, (2009, 8, 17)), "G20": ("BLOCK IIR-A", 1154.0, (2000, 5, 11))}

Record = tuple[float, float, float, float]


def sp3_text(
    orbits: dict[str, Sequence[Record]] | None = None,
    *,
    system: str = "GPS",
    version: str = "c",
    first_s: float = 0.0,
    flags: dict[tuple[str, int], str] | None = None,
) -> str:
    """Return an SP3 file of these orbits from ``first_s`` after midnight; ``flags`` are its columns 75 to 80."""
    given = dict(ORBITS if orbits is None else orbits)
    count = len(next(iter(given.values())))
    names = "".join(given).ljust(51)
    lines = [
        f"#{version}P2010  7  1  0  0  0.00000000 {count:7d} ORBIT IGS05 HLM  IGS",
        "## 1590 345600.00000000   900.00000000 55378 0.0000000000000",
        f"+  {len(given):3d}   " + names.replace("   ", "  0"),
        *["+        " + "  0" * 17] * 4,
        *["++       " + "  0" * 17] * 5,
        f"%c G  cc {system} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        *["%f  1.2500000  1.025000000  0.00000000000  0.000000000000000"] * 2,
        *["%i    0    0    0    0      0      0      0      0         0"] * 2,
        *["/* EXCERPT OF THE FINAL ORBITS OF THE DAY"] * 4,
    ]
    for k in range(count):
        minute, second = divmod(first_s + k * STEP_S, 60.0)
        hour, minute = divmod(int(minute), 60)
        lines.append(f"*  2010  7  1 {hour:2d} {minute:2d} {second:11.8f}")
        for name, records in given.items():
            line = f"P{name}" + "".join(f"{value:14.6f}" for value in records[k])
            lines.append(line.ljust(74) + (flags or {}).get((name, k), ""))
    return "\n".join([*lines, "EOF", ""])


def clock_text(first_minute: int = 0, step_minutes: int = 5, system: str = "GPS") -> str:
    """Return a RINEX clock file of ``CLOCKS``."""
    lines = [
        "     3.00           C                                       RINEX VERSION / TYPE",
        f"   {system}".ljust(60) + "TIME SYSTEM ID",
        "     1    AS".ljust(60) + "# / TYPES OF DATA",
        " " * 60 + "END OF HEADER",
    ]
    for k in range(len(CLOCKS["G05"])):
        hour, minute = divmod(first_minute + step_minutes * k, 60)
        for name, values in CLOCKS.items():
            lines.append(f"AS {name}  2010 07 01 {hour:02d} {minute:02d}  0.000000  1   {values[k]:19.12e}")
    return "\n".join(lines) + "\n"


def antex_text() -> str:
    """Return an ANTEX file of both satellites."""
    lines = [
        "     1.4            M".ljust(60) + "ANTEX VERSION / SYST",
        "A".ljust(60) + "PCV TYPE / REFANT",
        " " * 60 + "END OF HEADER",
    ]
    for name, (block, z_mm, (year, month, day)) in ANTENNAS.items():
        lines.append(" " * 60 + "START OF ANTENNA")
        lines.append(f"{block:20}{name:20}G0{name[1:]:8}{'':10}".ljust(60) + "TYPE / SERIAL NO")
        lines.append(" " * 20 + "GFZ/TUM                  0    20-APR-05 METH / BY / # / DATE")
        lines.append("     0.0".ljust(60) + "DAZI")
        lines.append("     0.0  14.0  14.0".ljust(60) + "ZEN1 / ZEN2 / DZEN")
        lines.append("     2".ljust(60) + "# OF FREQUENCIES")
        lines.append(f"{year:6d}{month:6d}{day:6d}     0     0    0.0000000".ljust(60) + "VALID FROM")
        for label in ("G01", "G02"):
            lines.append(f"   {label}".ljust(60) + "START OF FREQUENCY")
            lines.append(f"{0.0:10.2f}{0.0:10.2f}{z_mm:10.2f}".ljust(60) + "NORTH / EAST / UP")
            lines.append("   NOAZI    0.00    0.00")
            lines.append(f"   {label}".ljust(60) + "END OF FREQUENCY")
        lines.append(" " * 60 + "END OF ANTENNA")
    return "\n".join(lines) + "\n"


def products(folder: Path, *texts: str) -> PreciseProducts:
    """Return what the files with these texts give; the day's SP3 file when there is none."""
    paths = []
    for k, text in enumerate(texts or (sp3_text(),)):
        paths.append(folder / f"product_{k}")
        paths[-1].write_text(text)
    return read_precise(paths)[0]


def messages(folder: Path) -> EphemerisTable:
    """Return the broadcast messages of the day."""
    path = folder / "broadcast.rnx"
    path.write_text(NAVIGATION)
    return read_navigation([path])[0].ephemerides
