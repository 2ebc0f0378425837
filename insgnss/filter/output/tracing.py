"""Writing a bank's state, and now and then its covariance, at the times at which it is wanted, compiled."""

from __future__ import annotations

from insgnss.filter.output.gps_time import covariance_at_gps_time
from insgnss.filter.output.trace_rows import TraceRoom, covariance_due, write_covariance, write_state
from insgnss.filter.output.writing import mixture_covariance
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import Scratch, propagate_covariance
from insgnss.filter.sensor_errors import biases_to_whole_errors
from insgnss.filter.soundness import is_finite
from insgnss.filter.state import Bank, HeadRecord, copy_matrix
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(apart=True)
def write_trace(
    bank: Bank,
    t_ns: int,
    with_covariance: bool,
    par: Parameters,
    room: TraceRoom,
    P_out: Float64,
    scratch: Scratch,
) -> None:
    """Write the leader's state at the bank's time ``t_ns``, and the covariance there where it is due or asked for.

    It is the leader's, or the bank's while the heading is open; a state that is not finite gives none. The slow errors
    are not in it: it predicts what the receiver measures, and its ranges have them as the state has. The work space is
    handed over in its parts: handing over all of it would cost more than the row.

    Parameters
    ----------
    P_out : (n, n) scratch
    """
    head: HeadRecord = bank.head[0]
    if not is_finite(bank.state[head.leader], bank.P[head.leader]):
        return
    write_state(room, t_ns, bank.state[head.leader], par)
    if not (with_covariance or covariance_due(head, room.counts[0].newest_ns, t_ns, room.interval_ns)):
        return
    if bank.state.shape[0] > 1:
        mixture_covariance(bank, P_out)
    else:
        copy_matrix(bank.P[0], P_out)
        propagate_covariance(bank.state[0], P_out, par, scratch)
    covariance_at_gps_time(bank.state[head.leader], par, P_out)
    biases_to_whole_errors(bank.state[head.leader], par, P_out)
    write_covariance(room, t_ns, P_out)
