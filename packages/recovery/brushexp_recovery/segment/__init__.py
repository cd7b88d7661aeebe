"""Predict maps of a picture with the network, and divide it into superpixels along the predicted borders."""
