"""Parse the command line, answer ``--help``, and start the requested task."""
