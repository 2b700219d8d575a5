"""From recorded tracks to a network: the four steps of a calibration, and what is told of its result."""
