"""Files written as a whole, what they are called, and the hashes of what they hold."""
