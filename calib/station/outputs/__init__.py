"""The ways out of the station: output.py says what one is, a folder each; registry.py opens those that are wanted."""
