"""Results of others: verify, merge, compare, show; and the certificate of a method."""
