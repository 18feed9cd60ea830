"""``rauca bench optimize``: where the milliseconds of an optimiser's step go."""
