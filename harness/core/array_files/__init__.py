"""Untrusted files of arrays: pickles and NPZ, read without running any code in them."""
