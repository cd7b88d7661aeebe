"""What is typed and chosen, as a checked config: keys of the tasks, presets, looks."""
