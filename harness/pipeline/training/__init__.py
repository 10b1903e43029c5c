"""Training data and training runs of the open parts.

Read ``normals`` for a training from subjects to a network. ``samples`` makes what it learns from,
by ``viewpoint``, ``shading`` and ``prints``; ``sittings`` keeps what a network has been through.
"""
