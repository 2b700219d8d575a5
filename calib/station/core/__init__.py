"""What the station decides, and no I/O: it is handed messages and times, and opens nothing."""
