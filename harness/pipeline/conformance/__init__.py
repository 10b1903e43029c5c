"""Whether a method keeps the contract: trials in processes of their own, checks, a certificate."""
