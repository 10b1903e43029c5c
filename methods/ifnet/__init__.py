"""IF-Nets+, which completes a surface in a lattice, from the user's own ``ifnet.ckpt``."""
