"""ECON's normal networks, from the user's own ``normal.ckpt``."""
