"""Training of detectors: one resumable loop, hardening, and what they are shown."""
