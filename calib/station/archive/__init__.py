"""What is kept: recordings, what is still to be fetched for them, track folders, and the memory over a restart."""
