"""Convert times of day and dates in text files to seconds."""

from __future__ import annotations

import math
import re

import numpy as np

from anhyst.data.formats.channels import Texts
from anhyst.support.numeric import FloatArray

TIME_STAMP = re.compile(
    r"(?P<date>\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]+)?"
    r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}([.,]\d+|:\d{3})?) ?(?P<half>[AP]M)?(Z|(?P<zone>[+-]\d\d:?\d\d))?"
    r"|\d{4}[-/]\d{2}[-/]\d{2}|\d{1,2}\.\d{1,2}\.\d{4}|\d{1,2}/\d{1,2}/\d{4}",
    re.IGNORECASE,
)
"""A time of day with or without a date, or a date alone (then the group ``h`` is empty)."""
_DAY_S = 86400.0


def seconds_since_first(stamps: Texts) -> FloatArray:
    """Return times of day as s since the first one; a clock that restarts at midnight continues."""
    seconds = np.array([second_of_day(text) for text in stamps.values])[stamps.codes]
    midnights = np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -0.5 * _DAY_S)
    return np.asarray(seconds + _DAY_S * midnights - seconds[:1])


def second_of_day(text: str) -> float:
    """Return a time of day, s; NaN if the text does not contain one."""
    match = TIME_STAMP.fullmatch(text)
    if match is None or match["h"] is None:
        return math.nan
    hour = int(match["h"])
    if match["half"]:
        hour = hour % 12 + 12 * (match["half"].upper() == "PM")
    whole_seconds, _, fraction = match["s"].replace(",", ".").replace(":", ".").partition(".")
    if match["zone"]:  # in UTC, so that a change from summer time has no effect
        zone_text = match["zone"].replace(":", "")
        hour -= int(zone_text[:3])
    return 3600.0 * hour + 60.0 * int(match["m"]) + int(whole_seconds) + float(f"0.{fraction or 0}")
