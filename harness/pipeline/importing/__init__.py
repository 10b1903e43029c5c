"""Photos and cameras of other programs become captures: masks, checks, and a world in metres."""
