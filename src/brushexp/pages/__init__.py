"""Pages that people look at: one HTML file each, which holds all it needs and asks nothing of any network."""
