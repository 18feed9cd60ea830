"""Which face each subsample of an image sees."""
