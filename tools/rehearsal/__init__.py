"""A bare Debian, booted with systemd and without a network, and a life of Skyfix on it, under its own units.

The hazard is a sandbox that nobody runs in: tests start the programs by hand, the field starts them by their units. So
what is installed here is the bundle, by the README's lines, and what answers is what the units run.
"""
