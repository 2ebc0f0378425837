"""Physical and system constants, each once: the unit in the name, the source in the comment."""

from __future__ import annotations

from typing import Final

C_MPS: Final = 299_792_458.0  # speed of light; exact by definition of the metre (BIPM SI brochure)

# WGS-84, NGA.STND.0036 (2014), tables 3.1, 3.4 and 3.5
WGS84_A_M: Final = 6_378_137.0  # semi-major axis
WGS84_INV_F: Final = 298.257223563  # inverse flattening
WGS84_F: Final = 1.0 / WGS84_INV_F
WGS84_B_M: Final = WGS84_A_M * (1.0 - WGS84_F)  # semi-minor axis
WGS84_E2: Final = WGS84_F * (2.0 - WGS84_F)  # first eccentricity squared
WGS84_GM_M3PS2: Final = 3.986004418e14  # with atmosphere
WGS84_OMEGA_RADPS: Final = 7.292115e-5  # rotation rate of the Earth
WGS84_J2: Final = 1.082629821313e-3  # from C20,bar = -0.484166774985e-3 (table 3.5), J2 = -sqrt(5) C20

STANDARD_GRAVITY_MPS2: Final = 9.80665  # the unit g; ISO 80000-3

NS_PER_S: Final = 1_000_000_000
NS_PER_MS: Final = 1_000_000
NS_PER_US: Final = 1_000
S_PER_WEEK: Final = 604_800
NS_PER_WEEK: Final = S_PER_WEEK * NS_PER_S
S_PER_DAY: Final = 86_400
NS_PER_DAY: Final = S_PER_DAY * NS_PER_S

M_PER_KM: Final = 1000.0
SIGMA_PER_MEDIAN: Final = 1.4826  # of a normal error: sigma over the median of its size

SYSTEMS: Final = "GRECJIS"  # GPS, GLONASS, Galileo, BeiDou, QZSS, NavIC, SBAS: letters of RINEX 3

# Broadcast orbits: each system's own gravitational constant and Earth rotation rate. The factor F of the clock's
# periodic relativity follows from mu in each ICD, F = -2 sqrt(mu) / c^2. QZSS (IS-QZSS-PNT-005, 5.5.2) and NavIC (SPS
# ICD 1.1, 6.2.3) use the numbers of GPS.
GPS_MU_M3PS2: Final = 3.986005e14  # IS-GPS-200N, table 20-IV
GPS_OMEGA_RADPS: Final = 7.2921151467e-5  # IS-GPS-200N, table 20-IV
GALILEO_MU_M3PS2: Final = 3.986004418e14  # Galileo OS SIS ICD 2.1, table 60
GALILEO_OMEGA_RADPS: Final = 7.2921151467e-5  # Galileo OS SIS ICD 2.1, table 60
BEIDOU_MU_M3PS2: Final = 3.986004418e14  # BDS-SIS-ICD B1I 3.0, table 5-11 (CGCS2000)
BEIDOU_OMEGA_RADPS: Final = 7.2921150e-5  # BDS-SIS-ICD B1I 3.0, table 5-11 (CGCS2000)
BEIDOU_GEO_TILT_DEG: Final = -5.0  # BDS-SIS-ICD B1I 3.0, table 5-11: the rotation R_x(-5 deg)

# GLONASS: orbit by integration in PZ-90.11, which equals WGS-84 to centimetres (GLONASS ICD 5.1, 3.3.4 and A.3.1.2)
GLONASS_MU_M3PS2: Final = 3.986004418e14  # GLONASS ICD 5.1, table 3.2
GLONASS_OMEGA_RADPS: Final = 7.292115e-5  # GLONASS ICD 5.1, table 3.2
GLONASS_A_M: Final = 6_378_136.0  # equatorial radius; GLONASS ICD 5.1, table 3.2
GLONASS_J2: Final = 1.08262575e-3  # GLONASS ICD 5.1, table 3.2 (1082625.75e-9)
