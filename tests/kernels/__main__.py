"""Run every case and pickle the recording into the file given."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

from tests.kernels import record

Path(sys.argv[1]).write_bytes(pickle.dumps(record()))
