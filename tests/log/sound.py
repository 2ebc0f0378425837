"""What holds of every table that a reader returns, however damaged its file was."""

from __future__ import annotations

import numpy as np

from insgnss.log.receiver import ReceiverLog
from insgnss.tables import GnssTable, ImuTable, NavigationData


def check_table(table: GnssTable) -> None:
    """Check times, numbers, and the numbers of satellites and signals."""
    n = len(table.t_ns)
    assert n > 0 and (np.diff(table.t_ns) >= 0).all()
    numbers = (table.pseudorange_m, table.doppler_hz, table.range_rate_mps, table.cn0_dbhz)
    for values in (*numbers, table.carrier_cycles):
        assert values is None or (len(values) == n and not np.isinf(values).any())
    assert table.lli is None or (len(table.lli) == n and ((table.lli >= 0) & (table.lli < 8)).all())
    assert ((table.sv >= 0) & (table.sv < len(table.sv_names))).all()
    assert ((table.signal >= 0) & (table.signal < len(table.signal_names))).all()
    assert (table.bad_cells < n).all()


def check_imu(table: ImuTable) -> None:
    """Check that times grow and all samples are numbers."""
    assert (np.diff(table.t_ns) > 0).all() and (table.t_ns >= 0).all()
    assert np.isfinite(table.w_ib_b).all() and np.isfinite(table.f_b).all()


def check_navigation(navigation: NavigationData) -> None:
    """Check that the messages have their satellites and numbers."""
    table = navigation.ephemerides
    assert len(table.sv_names) == len(table.toe_ns) == len(table.group_delay_s)
    assert np.isfinite(table.af0).all() and np.isfinite(table.sqrt_a).all()


def check_log(log: ReceiverLog) -> None:
    """Check everything in a receiver's file: measurements, or else inertial samples, a solution or fixes."""
    if len(log.gnss.t_ns):
        check_table(log.gnss)
    else:
        assert log.imu is not None or log.solution is not None or log.fixes is not None
    for fixes in (log.solution, log.fixes, log.satellite_fixes()):
        if fixes is not None:
            assert (np.diff(fixes.t_ns) > 0).all()
            assert np.isfinite([fixes.lat_deg, fixes.lon_deg, fixes.h_m]).all()
    if log.imu is not None:
        check_imu(log.imu)
    if log.navigation is not None:
        check_navigation(log.navigation)
