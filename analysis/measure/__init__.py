"""What is read off runs, and how far it lies from a theory."""
