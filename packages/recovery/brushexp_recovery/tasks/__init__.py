"""What the command line starts: one module per task, and the keys of all tasks."""
