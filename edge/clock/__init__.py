"""How good this machine's UTC is, as whoever disciplines it says: chrony, the kernel, or PTP."""
