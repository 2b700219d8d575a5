"""From a network and rays to targets, live: which ray is whose, and where each object is."""
