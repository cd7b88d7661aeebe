"""Read a command line, answer ``--help``, and begin a task."""
