"""A site's certificates: who belongs to it."""
