"""How the station is: one struct, and the ways in which it is asked for."""
