"""A task in a folder of its own."""
