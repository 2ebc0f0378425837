"""The schema of any table in a flight file: how its time counts, and how columns and numbers are written."""

from __future__ import annotations

import datetime as dt
import re
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from insgnss.config.strict import StrictModel

TWO_ROLLOVERS_S = 1.3e9  # of a week number of ten bits, 1024 weeks each: what an offset may have to mend
NO_COLUMN = "none"  # instead of a column's name: the log has no such column
_MOST_COLUMNS = 10_000
# in the name of a column, without blanks and marks
_DAY_OF_YEAR = re.compile(r"doy|of(?:the)?year|yearday|[jy]day|julian|ordinal", re.IGNORECASE)


def _by_number(name: Any) -> Any:
    """Return the number of a column, counted from 1, as the name "#3"; a name stays."""
    if not isinstance(name, int) or isinstance(name, bool):
        return name
    if not 1 <= name <= _MOST_COLUMNS:
        raise ValueError(f"columns are counted from 1; got {name}")
    return f"#{name}"


ColumnName = Annotated[str, BeforeValidator(_by_number)]
Names3 = tuple[ColumnName, ColumnName, ColumnName]


def _one_or_parts(names: Any, counts: tuple[int, ...]) -> Any:
    """Return a column, or the columns of its parts; ``counts`` of parts are allowed."""
    if isinstance(names, list | tuple):
        if len(names) != len(set(names)) or len(names) not in counts:
            many = " or ".join({2: "two", 3: "three"}[count] for count in counts)
            raise ValueError(
                f"one column, or {many} different ones, the longest unit first; got {list(names)}"
            )
        return tuple(map(_by_number, names))
    return _by_number(names)


TimeColumns = Annotated[str | tuple[str, str, str], BeforeValidator(lambda names: _one_or_parts(names, (3,)))]
DateColumns = Annotated[
    str | tuple[str, str] | tuple[str, str, str],
    BeforeValidator(lambda names: _one_or_parts(names, (2, 3))),
]


class TimeScale(StrictModel):
    """How the time column of a log counts: ``gps = column * unit + origin + offset_s (+ leap seconds if UTC)``."""

    unit: Literal["s", "ms", "us", "ns"] = "s"
    origin: Literal["gps_week", "gps_epoch", "unix_epoch", "calendar"] = Field(
        "gps_week", description="origin of numeric times; 'calendar': dates such as 2025-08-28T17:30:22.961Z"
    )
    date_order: Literal["ymd", "dmy", "mdy", "yd"] = Field(
        "ymd",
        description="order of year, month and day in a date; 'yd': columns.date names years and days of the year",
    )
    date: dt.date | None = Field(
        None, description="date of the first row, where the log holds only times of day"
    )
    scale: Literal["gps", "utc"] = Field("gps", description="time scale; must be given for dates")
    leap_seconds: Annotated[int, Field(ge=0, le=100)] | None = Field(
        None, description="GPS minus UTC [s], 18 since 2017; left out: by date"
    )
    offset_s: float = Field(
        0.0, ge=-TWO_ROLLOVERS_S, le=TWO_ROLLOVERS_S, description="added to every time tag of the log [s]"
    )

    @model_validator(mode="after")
    def _leap_seconds_are_of_utc(self, info: ValidationInfo) -> TimeScale:
        # only as a file says it: a proposal of another scale may leave them over
        if info.mode == "json" and self.leap_seconds is not None and self.scale != "utc":
            raise ValueError("leap_seconds apply only to UTC: write scale = 'utc' too, or leave them out")
        return self

    @model_validator(mode="after")
    def _dates_have_a_scale_and_no_unit(self) -> TimeScale:
        if self.origin != "calendar" and self.date_order != "ymd":
            raise ValueError(
                "date_order applies only to dates: write origin = 'calendar' too, or leave it out"
            )
        if self.date is not None and (self.origin != "calendar" or self.date_order != "ymd"):
            raise ValueError(
                "time.date completes times of day: write origin = 'calendar' too, and leave date_order out"
            )
        if self.origin == "calendar" and "scale" not in self.model_fields_set:
            raise ValueError(
                "declare the time scale of the dates: scale = 'utc' (dates that end in Z), or 'gps'"
            )
        return self

    @model_serializer(mode="wrap")
    def _what_is_declared(self, all_keys: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # a unit or an order that is written has a meaning that the default has not: a copy must not write it
        undeclared = {"unit", "date_order"} - self.model_fields_set
        return {key: value for key, value in all_keys(self).items() if key not in undeclared}


def require_different(names: tuple[str, ...], advice: str) -> None:
    """Refuse columns of which two have one name.

    Raises
    ------
    ValueError : they do
    """
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"'{twice}' is named for two things: {advice}")


class LogColumns(StrictModel):
    """Names of the columns of a log, all different; a number names a column of a file without a header."""

    time: TimeColumns = Field(
        "time_s", description="column of times; for times of day also three: hours, minutes, seconds"
    )
    date: DateColumns = Field(
        NO_COLUMN,
        description="column of dates, where the time column holds the time of day; or of years, months, days; or of"
        " years, days of the year, if the name of the second says so ('doy') or time.date_order is 'yd'",
    )
    week: ColumnName = Field(
        NO_COLUMN, description="column of GPS weeks, where the time column holds seconds of the week"
    )
    nanoseconds: ColumnName = Field(
        NO_COLUMN, description="column added to the time column, as ROS writes sec and nanosec"
    )

    @model_validator(mode="after")
    def _names_are_different(self) -> Self:
        for names in self.tables():
            require_different(names, "each needs a column of its own")
        return self

    @property
    def time_names(self) -> tuple[str, ...]:
        """The column of times, or those of hours, minutes and seconds."""
        return (self.time,) if isinstance(self.time, str) else self.time

    @property
    def date_names(self) -> tuple[str, ...]:
        """The column of dates, or those of years, months and days, or years and days of the year; empty without any."""
        names = (self.date,) if isinstance(self.date, str) else self.date
        return () if names == (NO_COLUMN,) else names

    @property
    def of_time(self) -> tuple[str, ...]:
        """All columns of which a row's time is made."""
        names = (self.week, *self.date_names, *self.time_names, self.nanoseconds)
        return tuple(name for name in names if name != NO_COLUMN)

    def tables(self) -> tuple[tuple[str, ...], ...]:
        """Return the names of the columns of each file that the log may consist of."""
        return (self.all_names(),)

    def all_names(self) -> tuple[str, ...]:
        """Return every name of a column, without ``NO_COLUMN``."""
        values = [value for _, value in self]
        names = (name for value in values for name in ((value,) if isinstance(value, str) else value))
        return tuple(name for name in names if name != NO_COLUMN)

    def chosen_names(self) -> tuple[str, ...]:
        """Return the names that are not the usual ones: the file must have these columns."""
        return tuple(name for name in self.all_names() if name not in type(self)().all_names())


class LogTable(StrictModel):
    """A log that may be a table of text: its columns, its time, its decimal mark."""

    columns: LogColumns = LogColumns()
    time: TimeScale = TimeScale()
    decimal: Literal[".", ","] = Field(".", description="decimal mark of the numbers")

    @model_validator(mode="after")
    def _time_columns_fit_the_origin(self) -> Self:
        for name, origin in (("date", "calendar"), ("week", "gps_week")):
            if getattr(self.columns, name) != NO_COLUMN and self.time.origin != origin:
                raise ValueError(
                    f"columns.{name} goes with time.origin = '{origin}', not '{self.time.origin}'"
                )
        is_of_parts = len(self.columns.time_names) > 1
        if is_of_parts and not self.columns.date_names and self.time.date is None:
            raise ValueError(
                "columns.time of hours, minutes and seconds needs a date: name columns.date, or write time.date"
            )
        if is_of_parts and "unit" in self.time.model_fields_set:
            raise ValueError(
                "unit applies to a single column of numbers: leave it out with columns of hours, minutes and seconds"
            )
        self._check_date_parts()
        if self.time.origin != "calendar":
            return self
        if self.columns.nanoseconds != NO_COLUMN:
            raise ValueError(
                "columns.nanoseconds goes with times that are numbers, not with origin = 'calendar'"
            )
        if self.columns.date_names and self.time.date is not None:
            raise ValueError("time.date and columns.date both state the date: leave one of them out")
        if self.time.unit != "s" and not self.columns.date_names and self.time.date is None:
            raise ValueError(
                "unit applies to numbers: leave it out with origin = 'calendar', or name the column of dates as"
                " columns.date where columns.time counts from midnight"
            )
        return self

    def _check_date_parts(self) -> None:
        """Refuse columns of parts of a date that contradict the declared order, or do not say what they count.

        Raises
        ------
        ValueError : they do
        """
        names, order = self.columns.date_names, self.time.date_order
        if len(names) != 2 and order == "yd":
            raise ValueError(
                "date_order = 'yd' applies to two columns, years and days of the year: name both as columns.date"
            )
        if len(names) == 3 and order != "ymd":
            raise ValueError("columns.date lists years, months, days in this order: leave date_order out")
        if len(names) == 2 and order not in ("ymd", "yd"):
            raise ValueError("columns.date lists years, days of the year in this order: leave date_order out")
        if len(names) == 2 and order != "yd" and not _DAY_OF_YEAR.search(re.sub(r"[\W_]", "", names[1])):
            raise ValueError(
                f"columns.date = {list(names)}: two columns are read as years and days of the year, and"
                f" '{names[1]}' does not say that it counts these. If it does (1 to 366), write time.date_order = 'yd'"
                " or give the column such a name as 'doy'; a date by months needs three columns: years, months, days"
            )

    @property
    def counts_in_gps_week(self) -> bool:
        """Whether the times are seconds of the week that the flight file declares."""
        return self.time.origin == "gps_week" and self.columns.week == NO_COLUMN
