"""A campaign's results: a data set of Parquet files, summarised piece by piece, whatever its size.

Quantiles come from a histogram whose bins grow by 2 %: they are right to 1 % of their value, and a column costs some
thousand numbers per group, whatever the number of rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds

from insgnss.errors import ConfigError, ResultError
from insgnss.studies.campaign.study import CampaignConfig
from insgnss.studies.campaign.tasks import KEY_COLUMNS, RESULTS
from insgnss.tables import Float64

_GROWTH: Final = math.log(1.02)  # of the histogram's bins
_SMALLEST: Final = 1e-12  # in size; smaller is zero
_BATCH_ROWS: Final = 65_536
_QUANTILES: Final = (0.05, 0.5, 0.95)


@dataclass
class Sums:
    """Count, moments, extremes and histogram of a column in a group."""

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0  # about the mean
    least: float = math.inf
    most: float = -math.inf
    bins: dict[int, int] = field(default_factory=dict)

    def add(self, values: Float64) -> None:
        """Take in values; NaN do not count.

        Equation: M2 = M2_a + M2_b + d^2 n_a n_b / n, d the difference of the means         [Chan et al. 1983]
        """
        values = values[np.isfinite(values)]
        if not len(values):
            return
        n, m = len(values), float(values.mean())
        d, total = m - self.mean, self.count + n
        self.squares += float(np.sum((values - m) ** 2)) + d * d * self.count * n / total
        self.mean += d * n / total
        self.count = total
        self.least, self.most = min(self.least, float(values.min())), max(self.most, float(values.max()))
        for number, times in zip(*np.unique(_bin(values), return_counts=True), strict=True):
            self.bins[int(number)] = self.bins.get(int(number), 0) + int(times)

    def quantile(self, p: float) -> float:
        """Return the value below which a share ``p`` lies."""
        wanted, seen = p * (self.count - 1), 0
        for number in sorted(self.bins):
            seen += self.bins[number]
            if seen > wanted:
                return min(max(_middle(number), self.least), self.most)
        return self.most

    def row(self) -> dict[str, float]:
        """Return the summary of the column."""
        if not self.count:
            return {"n": 0}
        sd = math.sqrt(self.squares / (self.count - 1)) if self.count > 1 else math.nan
        rms = math.sqrt(self.squares / self.count + self.mean**2)
        numbers = {
            "n": self.count,
            "mean": self.mean,
            "sd": sd,
            "rms": rms,
            "min": self.least,
            "max": self.most,
        }
        return numbers | {f"p{round(100 * p):02d}": self.quantile(p) for p in _QUANTILES}


def _bin(values: Float64) -> Any:
    """Return the numbers of the values' bins, zero that of zero, in the order of the values."""
    size = np.abs(values)
    some = size > _SMALLEST
    number = np.zeros(len(values), np.int64)
    number[some] = 1 + np.floor(np.log(size[some] / _SMALLEST) / _GROWTH).astype(np.int64)
    return np.where(values < 0.0, -number, number)


def _middle(number: int) -> float:
    if number == 0:
        return 0.0
    return math.copysign(_SMALLEST * math.exp((abs(number) - 0.5) * _GROWTH), number)


def data_set(folder: str | Path) -> Any:
    """Return a campaign's results as a PyArrow data set, to be queried without loading it.

    Raises
    ------
    ResultError : the folder holds none
    """
    files = sorted((Path(folder) / RESULTS).glob("case-*.parquet"))
    if not files:
        raise ResultError("no results in the folder", file=folder, advice="run the campaign first")
    # a task whose runs all failed has fewer columns: the schemas of all files together
    schemas = [ds.dataset(file).schema.remove_metadata() for file in files]
    schema = pa.unify_schemas(schemas, promote_options="permissive")
    return ds.dataset([str(file) for file in files], schema=schema)


def summary(folder: str | Path, by: Sequence[str] = ("case",), columns: Sequence[str] = ()) -> pd.DataFrame:
    """Return count, mean, sd, rms, extremes and quantiles of columns by groups; one piece is in memory at a time.

    Parameters
    ----------
    by : columns that make a group
    columns : to sum up; all numbers that are neither grouped by nor part of the case when empty

    Raises
    ------
    ResultError, ConfigError : the folder holds no results, or not such a column
    """
    whole = data_set(folder)
    names = list(columns) or [
        f.name for f in whole.schema if _is_number(f) and f.name not in (*by, *KEY_COLUMNS)
    ]
    names = [n for n in names if columns or not n.startswith("case_")]
    for name in (*by, *names):
        if name not in whole.schema.names:
            advice = f"there are {', '.join(whole.schema.names)}"
            raise ConfigError(f"the results have no column '{name}'", key=name, advice=advice)
    sums: dict[tuple[Any, ...], dict[str, Sums]] = {}
    wanted = list(dict.fromkeys((*by, *names)))
    for batch in whole.to_batches(columns=wanted, filter=ds.field("error") == "", batch_size=_BATCH_ROWS):
        table = batch.to_pandas()
        for key, rows in table.groupby(list(by), sort=False, dropna=False):
            group = sums.setdefault(key if isinstance(key, tuple) else (key,), {n: Sums() for n in names})
            for name in names:
                group[name].add(rows[name].to_numpy(np.float64))
    table_rows = [
        {**dict(zip(by, key, strict=True)), "column": name, **group[name].row()}
        for key, group in sums.items()
        for name in names
    ]
    return (
        pd.DataFrame(table_rows).sort_values(list(by), kind="stable").reset_index(drop=True)
        if table_rows
        else pd.DataFrame()
    )


def with_parameters(table: pd.DataFrame, config: CampaignConfig) -> pd.DataFrame:
    """Return a summary with the grid's values, which distinguish the cases, beside each case's number."""
    if "case" not in table.columns:
        return table
    cases = list(config.cases())
    values = {name: [cases[int(case)][name] for case in table["case"]] for name in config.grid}
    first = list(table.columns).index("case") + 1
    for place, (name, of_rows) in enumerate(values.items()):
        # a value may be a list: a column of objects, not a table of its own
        table.insert(
            first + place, name, pd.Series(of_rows, index=table.index, dtype=object), allow_duplicates=True
        )
    return table


def failures(folder: str | Path) -> pd.DataFrame:
    """Return the runs that failed: case, seed, error."""
    rows: pd.DataFrame = (
        data_set(folder).to_table(columns=list(KEY_COLUMNS), filter=ds.field("error") != "").to_pandas()
    )
    return rows


def _is_number(column: Any) -> bool:
    kind = column.type
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))
