"""Detectors of our own, for the families that have no weights one could get offline: two-stage and transformer.

Small, trained on this project's synthetic frames, and named as what they are (``frcnn-synth``, ``detr-synth``).
"""
