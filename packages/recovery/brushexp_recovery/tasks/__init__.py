"""What the command line starts: a module for each task, and the keys of all of them."""
