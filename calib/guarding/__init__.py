"""Whether a network in force is still true: fault detection and isolation from raw rays, without any filter."""
