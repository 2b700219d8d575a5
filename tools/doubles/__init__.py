"""A site in a box: real processes in network namespaces, and an air between them that loses, delays and cuts."""
