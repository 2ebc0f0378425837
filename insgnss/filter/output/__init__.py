"""The compiled loop's output: navigation rows, ledger, events, traces."""
