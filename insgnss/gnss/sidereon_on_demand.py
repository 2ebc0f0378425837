"""The reader library ``sidereon``, loaded when something of it is first used: it takes 15 MB and 30 ms."""

from __future__ import annotations

import importlib
from typing import Any


def __getattr__(name: str) -> Any:
    return getattr(importlib.import_module("sidereon"), name)
