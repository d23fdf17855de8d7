"""Limits that goal, operator and command line share."""

from __future__ import annotations

K_GAIN_MAX = 0.5  # authority of the speed correction; correction_server's k_gain_max may be lower


def k_gain_limit(parameters: dict[str, dict]) -> float:
    """What goal and correction server allow; parameters: of the nodes by their names, as far as known."""
    server = parameters.get('correction_server', {})
    return min(K_GAIN_MAX, server.get('k_gain_max', K_GAIN_MAX))
