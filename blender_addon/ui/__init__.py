"""Panels and properties; no scene logic in here."""
