"""What stills cannot say: a sensor before the detector, trackers behind it, and figures of whole clips."""
