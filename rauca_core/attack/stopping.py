"""Stopping between steps is every long training's business: see `rauca_core.stopping`."""

from ..stopping import StopRequest, stop_request

__all__ = ["StopRequest", "stop_request"]
