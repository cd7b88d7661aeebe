"""Less common losses, and the networks for LPIPS."""
