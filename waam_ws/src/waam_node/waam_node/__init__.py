"""What every node of the graph shares: parameters, heartbeat, diagnostics, quality of service."""
