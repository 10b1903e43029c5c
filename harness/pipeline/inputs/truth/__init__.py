"""What is known of a subject besides its scan, where it has to be worked out."""
