"""Each promise of the package on each path: the table of docs/promises.csv, asserted."""
