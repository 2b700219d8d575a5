"""Measuring a lens from pictures of a board: boards finds the corners, fit the lens, report says what was found."""
