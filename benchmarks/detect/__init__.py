"""``rauca bench detect``: every adapter beside the runtime its network comes from."""
