"""Thin programs that compose the rooms; each fits on one screen and holds no logic of its own."""
