"""Photos and camera files of other programs: read as they are, and written for them."""
