"""The optimiser's loop on frames and detectors that are hard to stay finite on."""
