"""The ground that box and base both stand on. It imports nothing else of the house."""
