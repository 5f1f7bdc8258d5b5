"""What a wave, a sheet or a network of spheres does, by independent derivations; reads no run but its scene."""
