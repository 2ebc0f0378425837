"""The navigation table's ``sd_slow_*``: the part of slowly varying errors, in addition to the filter's own sigma."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import LedgerPart
from insgnss.gnss.clock_groups import group_table
from insgnss.gnss.observation_rows import PSEUDORANGE
from insgnss.gnss.signals import L1_HZ, carrier_hz
from insgnss.gnss.slow_errors import SlowRows, SlowSigmas, slow_position_variances
from insgnss.runs.result_tables import LogNames, RowKeys
from insgnss.status import USED
from insgnss.tables import Float64, Int64

COLUMNS: Final = ("sd_slow_n_m", "sd_slow_e_m", "sd_slow_d_m")
# of an innovation's variance that is the range's own, as far as single precision resolves
_LEAST_SHARE: Final = 1e-4


class SlowVariances(NamedTuple):
    """P_slow of a log, at one epoch a second."""

    t_ns: Int64  # (m,)
    position: Float64  # (m, 3) diagonal, north-east-down [m^2]


def slow_variances(
    ledger: list[LedgerPart], keys: list[RowKeys], names: LogNames, setup: FilterSetup
) -> SlowVariances:
    """Return the effect of the settings' slow errors on the position, by the ranges that it used.

    Parameters
    ----------
    ledger, keys : parts of the log
    """
    sigmas = slow_sigmas(setup, names)
    group = group_table(*names, setup.clock_groups, setup.config.measurements.signals_of())
    factor = _ionosphere_factors(names)
    t_ns, variances = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    for part, key in zip(ledger, keys, strict=True):
        if not len(key.sv):  # a log without raw GNSS data
            continue
        rows = _rows(part, key, group, factor)
        epoch, variance = slow_position_variances(rows, sigmas, setup.ties)
        t_ns.append(key.epoch_ns[epoch])
        variances.append(variance)
    return SlowVariances(np.concatenate(t_ns), np.concatenate(variances))


def slow_columns(found: SlowVariances, t_ns: Int64) -> dict[str, Float64]:
    """Return the columns at navigation times (n,): of the latest epoch, else of the first; NaN where there is none."""
    if not len(found.t_ns):
        return {name: np.full(len(t_ns), np.nan) for name in COLUMNS}
    latest = np.maximum(np.searchsorted(found.t_ns, t_ns, side="right") - 1, 0)
    sigma = np.sqrt(found.position)[latest]
    return {name: sigma[:, i] for i, name in enumerate(COLUMNS)}


def slow_sigmas(setup: FilterSetup, names: LogNames) -> SlowSigmas:
    """Return the sizes of the slow errors that a filter's settings, models and products leave."""
    sizes = setup.slow_sizes
    largest = max(sizes.satellite.values())  # of an unknown system
    return SlowSigmas(
        np.array([sizes.satellite.get(sv[0], largest) for sv in names.sv]),
        sizes.ionosphere,
        sizes.ionosphere * setup.config.slow_errors.ionosphere_gradient_per_1000_km,
        sizes.troposphere,
    )


def _ionosphere_factors(names: LogNames) -> Float64:
    """Return the delay of each satellite and signal against that on L1 (s, c); 1 where the signal is unknown."""
    hz = [[carrier_hz(sv[0], code, 0) for code in names.signal] for sv in names.sv]
    return np.nan_to_num((L1_HZ / np.array(hz)) ** 2, nan=1.0)


def _rows(part: LedgerPart, key: RowKeys, group: Int64, factor: Float64) -> SlowRows:
    """Return the pseudoranges used in one epoch of each second."""
    entries, epoch = part.entries, key.epoch
    is_first = np.diff(key.epoch_ns // NS_PER_S, prepend=-1) != 0
    used = np.flatnonzero(is_first[epoch] & (entries["status"][:, PSEUDORANGE] == USED))
    variance = entries["variance"][used, PSEUDORANGE].astype(np.float64)
    r = variance - entries["predicted"][used, PSEUDORANGE]
    sv, signal = key.sv[used], key.signal[used]
    return SlowRows(
        epoch[used],
        entries["u_n"][used].astype(np.float64),
        np.maximum(r, _LEAST_SHARE * variance),
        sv,
        group[sv, signal],
        factor[sv, signal],
    )
