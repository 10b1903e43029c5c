"""Turn a capture into a clothed mesh."""
