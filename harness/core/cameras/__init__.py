"""The camera, its rigs, and the conventions of other programs."""
