"""What is left of a sweep for people to look at: one result per run, one table and one sheet of pictures over all."""
