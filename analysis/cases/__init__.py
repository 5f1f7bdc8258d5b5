"""Cases: runs, script and expected numbers of a figure, in a folder `NAME`. `granular-analysis case NAME` runs one."""
