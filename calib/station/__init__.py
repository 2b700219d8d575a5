"""The base-station process: everything of the mathematics' surroundings that touches the world."""
