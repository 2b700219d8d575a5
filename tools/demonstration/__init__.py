"""The parts of `make demo`: a whole site of real programs on one computer, with a flight that is known exactly."""
