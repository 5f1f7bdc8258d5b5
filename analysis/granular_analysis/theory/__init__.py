"""Independent derivations of what a wave, a sheet or a network of spheres does; reads no run but its scene."""
