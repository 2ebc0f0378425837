"""The command line as ``python -m insgnss``."""

from __future__ import annotations

from insgnss.cli.main import app

if __name__ == "__main__":
    app(prog_name="insgnss")
