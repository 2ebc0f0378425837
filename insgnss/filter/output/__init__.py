"""What the compiled loop writes: navigation rows, ledger, events, traces."""
