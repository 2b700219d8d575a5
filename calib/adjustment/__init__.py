"""The least-squares adjustment of cameras and flight: its unknowns, what is known beforehand, weights and sigmas."""
