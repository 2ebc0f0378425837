"""The columns of a campaign's results before there are any: a wrong name is refused before the runs, not after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from insgnss.errors import ConfigError
from insgnss.studies.campaign.results import data_set
from insgnss.studies.campaign.study import CampaignConfig
from insgnss.studies.campaign.tasks import KEY_COLUMNS, RESULTS
from insgnss.studies.matched_flight import BLOCKS

# of the rows of each shipped case function, in their order
COLUMNS: Final[Mapping[str, tuple[str, ...]]] = {
    "matched": (
        *("time_s", *(f"nees_{name}" for name in BLOCKS), "nis_range", "nis_rate", "refused"),
        *("position_error_m", "position_sd_m", "velocity_error_mps", "velocity_sd_mps"),
        *("attitude_error_rad", "attitude_sd_rad"),
    ),
    "masking": (
        *("way", "rms_during_m", "rms_after_m", "max_m", "false_rows", "believed", "true_refused"),
        *("delay_mean_s", "delay_max_s"),
    ),
    "outage": (
        *("window", "from_s", "end_m", "sd_end_m", "peak_m", "peak_mps", "sd_back_s", "drift_back_s"),
        "error_end_m",
    ),
    "receiver": (
        *("cn0_dbhz", "js_db", "lost", "position_m", "velocity_mps", "attitude_deg", "channels_mps"),
        *("range_m", "rate_mps", "phase_rad", "nees", "innovation_correlation", "cn0_estimated_dbhz"),
        "lost_s",
    ),
}


def require_columns(config: CampaignConfig, folder: str | Path, names: Sequence[str]) -> bool:
    """Refuse names that no column of a campaign's results has; return whether the columns are known yet.

    Those of a case function that is not shipped are known from its first results.

    Raises
    ------
    ConfigError : a column is unknown or named twice, or no column is named
    """
    if not names:
        raise ConfigError("no column is named", key="by", advice="name some, as in case,seed")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigError(f"column '{twice[0]}' is named twice", key="by", advice="name it once")
    known = _columns(config, Path(folder))
    for name in names if known else ():
        if name not in known:
            raise ConfigError(
                f"the results have no column '{name}'", key="by", advice=f"they have {', '.join(known)}"
            )
    return bool(known)


def _columns(config: CampaignConfig, folder: Path) -> tuple[str, ...]:
    """Return the columns of the results, none while they are unknown."""
    own = (*KEY_COLUMNS, *(f"case_{name}" for name in {**config.fixed, **config.grid}))
    if config.case in COLUMNS:
        return own + COLUMNS[config.case]
    if not any((folder / RESULTS).glob("case-*.parquet")):
        return ()
    # a task whose runs all failed has no columns of the function's rows
    there = tuple(data_set(folder).schema.names)
    return there if set(there) - set(own) else ()
