"""Cases: what one figure needs, each in a folder `NAME` of its own. `granular-analysis case NAME` runs one."""
