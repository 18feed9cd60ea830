"""Evaluation: average precision, results on disk, and statistics."""
