"""Detectors of the large frameworks. Each framework is imported when one of its detectors is made, not before."""
