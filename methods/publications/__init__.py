"""What publications state for their methods, and how ours differ from it."""
