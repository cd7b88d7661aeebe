"""Lightning modules that train networks, and the fit that they share."""
