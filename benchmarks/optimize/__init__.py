"""``rauca bench optimize``: where the milliseconds of an optimizer's step go."""
