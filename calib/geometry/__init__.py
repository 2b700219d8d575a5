"""Geometry of one camera, of two, and of a flight, each for itself: nothing here knows of a network."""
