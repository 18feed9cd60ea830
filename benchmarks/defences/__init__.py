"""What defences cost, what they do to clean pictures, and what they save: ``rauca bench defences``."""
