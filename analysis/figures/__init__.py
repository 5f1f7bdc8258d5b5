"""Scripts, each `python -m analysis.figures.NAME`: read runs, draw, print a table."""
