"""What a scene file declares, checked value by value; what follows from it stands in `rest`."""
