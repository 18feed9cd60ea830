"""``rauca bench environment``: every way to light a vehicle against Cycles, training times, what pre-training saves."""
