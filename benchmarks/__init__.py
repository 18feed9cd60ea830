"""Speed against error, by ``rauca bench``."""
