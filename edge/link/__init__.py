"""What crosses the network: sessions and who may open them, queues, and what waits on disk while the link is down."""
