"""How good a reconstruction is where no scan tells."""
