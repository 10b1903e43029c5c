"""Bodies, poses and landmarks of generated people."""
