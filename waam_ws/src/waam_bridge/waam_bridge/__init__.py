"""Host end of the link to the controller: segments to lines, telemetry to topics, and the arc lease."""
