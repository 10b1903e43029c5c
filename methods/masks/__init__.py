"""Networks of others that mark the person in a photo, which the user imported."""
