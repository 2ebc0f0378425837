"""Fixtures that every test may use."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

REPOSITORY = Path(__file__).resolve().parents[1]
REAL_DATA_VARIABLE = "INSGNSS_REAL_DATA"
GARBAGE_AFTER = 20_000

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let Python's search for garbage pass over modules and tests, a million objects that stay to the end.

    Then it comes after so many new objects, not after 700: half of the time of a test that reads syntax trees.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(GARBAGE_AFTER, 20, 20)
        gc.enable()


def real_data_folder() -> Path:
    """Return where the real logs are expected: ``INSGNSS_REAL_DATA``, else ``shared/data`` beside the checkout."""
    named = os.environ.get(REAL_DATA_VARIABLE)
    return Path(named) if named else REPOSITORY.parent / "shared" / "data"


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Return the folder of real logs; skip the test where it is absent."""
    folder = real_data_folder()
    if not folder.is_dir():
        pytest.skip(f"no real logs: {folder} does not exist; name their folder in {REAL_DATA_VARIABLE}")
    return folder


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Return a generator whose seed is the test's own name: the same numbers in any order of tests."""
    return np.random.default_rng(list(request.node.nodeid.encode()))
