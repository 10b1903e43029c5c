"""What people do with imported photos: reconstruct, look, hand on to other programs."""
