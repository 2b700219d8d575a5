"""Made-up flights: one seeded description, seen by made-up cameras, as tracks or as video."""
