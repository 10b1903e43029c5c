"""The open normal network and its training."""
