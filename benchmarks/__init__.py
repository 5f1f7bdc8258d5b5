"""How fast and how right: our run beside other ways to the same trajectory. ``make bench``, ``make scale``."""
