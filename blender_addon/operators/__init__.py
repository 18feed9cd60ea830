"""Operators, one a file: what an artist clicks."""
