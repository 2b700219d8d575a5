"""The camera box: what it sees becomes timestamped pixel tracks on the network."""

__version__ = "0.1.0"
