"""Commands that show, check and hand on what there is."""
