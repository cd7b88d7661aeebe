"""What is left of a sweep for people to look at: a result per run, a table, a sheet of pictures and plots over all."""
