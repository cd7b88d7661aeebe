"""A picture goes in; the network's maps of it, and superpixels between the borders that they show, come out."""
