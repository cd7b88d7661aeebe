"""Picture features for media, such as lines and smooth areas, and random fields of unlimited resolution."""
