"""Whether a network in force is still true: what raw rays say of each camera."""
