"""What work costs, and work that is made once for several methods."""
