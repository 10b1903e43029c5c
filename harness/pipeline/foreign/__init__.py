"""Methods that run in environments of their own, as a workspace knows them."""
