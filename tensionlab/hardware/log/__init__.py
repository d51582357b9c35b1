"""What is kept of a run, how it lies in a file, and how it is read."""
