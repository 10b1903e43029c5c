"""The training of normal networks, from generated subjects to a file that methods use.

Read ``train_normals`` for a training from subjects to a network. ``sampling`` makes what it learns
from, by ``viewpoint``, ``shading`` and ``fabric_prints``; ``learning`` has networks, losses and
loop; ``training_runs`` keeps what a network has been through; ``judging`` measures networks.
"""
