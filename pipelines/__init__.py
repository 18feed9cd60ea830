"""Thin programs that compose the rooms; each fits on one screen and holds no logic of its own."""

import os

# Torch's threads spin while they wait for each other. Beside a Blender that renders they spin away each other's time: a
# detector took longer with two threads than with one. Asleep, they cost a free machine little. OpenMP reads this when
# torch is loaded, and every program of ours comes through here before.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
