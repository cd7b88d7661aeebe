"""Less common losses, and the networks of LPIPS."""
