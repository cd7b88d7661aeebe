"""Read a command line, answer ``--help``, and start a task."""
