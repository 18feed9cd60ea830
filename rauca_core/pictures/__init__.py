"""Frames of photographs and of other simulators' pictures: camera, masks and estimated light."""
