"""Files of arrays from strangers: pickles and NPZ, read without running what else they hold."""
