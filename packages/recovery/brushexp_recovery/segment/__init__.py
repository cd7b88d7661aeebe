"""A picture goes in; the network's maps of it, and superpixels between the predicted borders, come out."""
