"""Made-up footage of made-up flights, with the truth of every frame."""
