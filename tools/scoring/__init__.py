"""How good is it: an estimate held against the truth, which has a clock and a frame of its own."""
